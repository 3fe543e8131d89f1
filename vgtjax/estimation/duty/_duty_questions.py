"""What a search is asked of the duty where it ends: whether that was late, linear between samples, or jumped there."""

import dataclasses

import numpy as np

from ..derivatives import Computation
from ..measurements import PERCEPTIBLE, Late, as_recorded, read_duties, sample_interval
from ..search import C, Progress, Report, beginning_again, first_progress, meets_noise, quiet
from ._duty import delay_told, holds_beside_edges, holds_of_duty, leaves_only_noise, may_be_linear
from ._edges import NEAR_ENOUGH, ROUNDS, alike, edges_of, find_edges, moved, possible, show_in, whole_samples


def asking_of_duty(calibrator: C, report: Report) -> Computation[C]:
    """A search that has ended once, gone on to its end where the duty is read as the traces tell."""
    return (yield from asking_beside_edges((yield from _asking(calibrator, report)), report))


def asking_beside_edges(calibrator: C, report: Report) -> Computation[C]:
    """What is asked last, where edges are known: a delay beside them, and whether the hold of others is decided."""
    ended = yield from _asking_of_delay_beside_edges(calibrator, report)
    progress = ended.minimiser.progress
    if progress.edges and not all(progress.edges) and not ended.is_lost():
        holds = yield from holds_beside_edges(ended.task, ended.minimiser, ended.minimiser.problem)
        met = leaves_only_noise(ended.task, ended.minimiser)
        decided = holds.decided and holds.linear == progress.linear and met
        ended.minimiser.progress = dataclasses.replace(progress, hold_decided=decided)
    return ended


def _asking(calibrator: C, report: Report) -> Computation[C]:
    """Slow traces beside edges are asked first, then edges that differ, also before a search begins again that may be
    stuck because of them."""
    calibrator = yield from _asking_of_slow_holds(calibrator, report)
    edged = yield from _asking_of_edges(calibrator, report, differing=True)
    if edged is not calibrator:
        return edged
    again = yield from beginning_again(calibrator, report)
    if again is not calibrator:
        edged = yield from _asking_of_edges(again, report, differing=True)
        if edged is not again:
            return edged
    ended = yield from _asking_of_hold(again, report)
    return (yield from _asking_of_edges(ended, report))


def _asking_of_hold(calibrator: C, report: Report) -> Computation[C]:
    """The search begun again where the traces tell of a late duty, or of one that was not held between samples.

    What they tell is read without numerical errors: a smooth seat alone made a duty late by five standard errors.
    A delay that is free from the first step on trades with the time constants of the plunger, and searches lost
    their way.
    """
    if calibrator.minimiser.progress.hold_decided is not None:  # it was interrupted behind this question
        return calibrator
    late = calibrator.minimiser.progress.late
    ended = yield from (_searching_beside(calibrator) if late else _asking_of_delay(calibrator, report))
    progress = ended.minimiser.progress
    if progress.edges:
        return ended
    if progress.late and not progress.corrections:
        report(progress)
        ended = (yield from ended.correcting()) or ended
    holds = yield from holds_of_duty(ended.task, ended.minimiser)
    if holds is None:
        return ended
    progress = ended.minimiser.progress
    already = set(holds.linear) == set(progress.linear)
    ended.minimiser.progress = dataclasses.replace(progress, hold_decided=already and holds.decided)
    if already or not set(holds.linear) > set(progress.linear):
        return (yield from _reading_early_as_linear(ended, report))
    here = progress.found or progress.coordinates
    onward = dataclasses.replace(progress, hold_decided=holds.decided)
    if not progress.late:
        return (yield from _reading_as_linear(ended, onward.reading_duty(here, holds.linear), report))
    coordinates = (*here[:-1], holds.delay / float(ended.transform.scale[-1]))
    return (yield from ended.searching_from(onward.reading_duty(coordinates, holds.linear), report))


def _reading_early_as_linear(ended: C, report: Report) -> Computation[C]:
    """The search gone on with every duty linear between samples and on time, where one was found that comes early,
    which none does, if it meets the traces as well so. The plunger's time constants make up for a part of half a
    sample, so that delays by kind of trace do not always tell."""
    progress, task = ended.minimiser.progress, ended.task
    every = tuple(sorted({sample_interval(trace) for trace in task.fit}))
    early = progress.late and progress.coordinates[-1] < 0 and task.unknown.duty_delay == "evidence"
    if not early or progress.linear == every or ended.is_lost():
        return ended
    here = (*(progress.found or progress.coordinates)[:-1], 0.0)
    onward = dataclasses.replace(progress.reading_duty(here, every), late=False, hold_decided=None)
    other = yield from ended.searching_from(onward)
    worse = 2 * ended.minimiser.problem.count * (other.minimiser.progress.searched - progress.searched)
    if other.is_lost() or worse > PERCEPTIBLE:
        return ended
    other = (yield from other.correcting()) or other
    holds = yield from holds_of_duty(task, other.minimiser)
    decided = holds is not None and holds.decided and holds.linear == every
    other.minimiser.progress = dataclasses.replace(other.minimiser.progress, hold_decided=decided)
    report(other.minimiser.progress)
    return other


def _asking_of_slow_holds(calibrator: C, report: Report) -> Computation[C]:
    """The search begun again where traces without edges tell that their duty was linear between samples, whatever the
    edges of the others, which a search would else move to where such a duty, read half a sample late, wants them."""
    task, search, edges = calibrator.task, calibrator.minimiser, as_recorded(calibrator.task.fit)
    asked = search.progress.linear or search.progress.edges or search.progress.hold_decided is not None
    if asked or not (task.unknown.duty_hold and any(edges) and may_be_linear(task)):
        return calibrator
    if calibrator.is_lost() or meets_noise(search):
        return calibrator
    what_moves = yield from edges_of(task, search.problem, edges, search.slopes.at, delay=search.progress.late)
    holds = yield from holds_beside_edges(task, search, search.problem.with_edges(what_moves))
    if not holds.linear:
        return calibrator
    begin = search.progress.began or first_progress(task).coordinates
    return (yield from _reading_as_linear(calibrator, search.progress.reading_duty(begin, holds.linear), report))


def _reading_as_linear(ended: C, onward: Progress, report: Report) -> Computation[C]:
    """The search gone on with a duty that is linear between samples, if that is evidently better. What is tried is not
    reported: a fit that is interrupted meanwhile tries it again."""
    progress = ended.minimiser.progress
    other = yield from ended.searching_from(onward)
    if other.is_lost() or not ended.worth(progress.searched - other.minimiser.progress.searched):
        return ended
    report(other.minimiser.progress)
    return other


def _asking_of_delay(calibrator: C, report: Report) -> Computation[C]:
    """The search with a free delay where the traces tell of one, or else the first correction of this one.

    Where something else than noise is left they are searched for a delay as well: at a delay of none the misfit may
    have a small minimum, where slopes tell of no other.
    """
    timely = (yield from calibrator.correcting()) or calibrator
    told = timely.is_lost() or (yield from delay_told(calibrator.task, timely.minimiser)) is not None
    if not told and leaves_only_noise(timely.task, timely.minimiser):
        return timely
    late = yield from _searching_late(calibrator, timely.minimiser.progress, report if told else quiet)
    edged = yield from _asking_of_edges(late, report, differing=True)
    if edged is not late:
        return edged
    late = yield from _searching_beside(late)
    return late if told or (not late.is_lost() and leaves_only_noise(late.task, late.minimiser)) else timely


def _asking_of_edges(calibrator: C, report: Report, *, differing: bool = False) -> Computation[C]:
    """The search with the times of the duty's edges free, where the misfit stays above the noise and this brings it
    down to that; if `differing`, only of edges whose times differ by parts of a sample, which no delay explains, but of
    any search (why, and why before a delay: `docs/estimation.md`, "Edges between samples").

    It begins where this one has ended and where this one began, and the better end counts. What is tried is not
    reported: a fit that is interrupted meanwhile tries all of it again.
    """
    task, progress = calibrator.task, calibrator.minimiser.progress
    read = read_duties(task.fit, progress.linear, ())
    edges = as_recorded(read)
    may_be = task.unknown.duty_hold and any(edges) and not progress.edges
    if not may_be or calibrator.is_lost():
        return calibrator
    if meets_noise(calibrator.minimiser):
        if not (differing or progress.late):
            return calibrator
        exact = (yield from calibrator.correcting()) or calibrator
        if not show_in(exact.minimiser.problem, exact.minimiser.slopes, read):
            return calibrator
    problem, slopes = calibrator.minimiser.problem, calibrator.minimiser.slopes
    knowing = problem.with_edges((yield from edges_of(task, problem, edges, slopes.at, delay=progress.late)))
    found = find_edges(knowing, slopes)
    if not (find_edges(knowing, slopes, beyond_delays=True) if differing else found).evident:
        return calibrator
    there = _moving_edges(calibrator, progress, moved(edges, found.late))
    if differing and there.late and not progress.late:
        return calibrator
    best = calibrator
    for begin in (progress.coordinates, progress.began or first_progress(task).coordinates):
        coordinates = (*begin[:-1], there.coordinates[-1])
        end = yield from _searching_edges(calibrator, there.moving_edges(coordinates, there.late, there.edges))
        ended = end.minimiser.progress
        may_be, lost = possible(ended.edges, delay=ended.late), end.is_lost()
        if not (may_be or lost):
            break
        met = may_be and not lost and leaves_only_noise(end.task, end.minimiser)
        better = calibrator.worth(best.minimiser.progress.searched - ended.searched)
        if met and better and not (differing and alike(ended.edges)):
            best, there = end, ended
    if best is not calibrator:
        report(best.minimiser.progress)
    return best


def _asking_of_delay_beside_edges(ended: C, report: Report) -> Computation[C]:
    """The search with a free delay, where edges are known and traces without any, linear between samples, tell of one.

    What computes such a duty holds it for a while as well, a millisecond for instance, so that it comes half of that
    late; edges come when they come.
    """
    progress = ended.minimiser.progress
    if not (progress.linear and progress.edges) or progress.late or ended.is_lost():
        return ended
    timely = (yield from ended.correcting()) or ended
    delay = yield from delay_told(ended.task, timely.minimiser)
    if delay is None or delay < 0:
        return ended
    onward = progress.moving_edges((*progress.coordinates[:-1], delay), True, progress.edges)
    end = yield from _searching_edges(ended, onward)
    found = end.minimiser.progress
    if end.is_lost() or not (possible(found.edges, delay=True) and ended.worth(progress.searched - found.searched)):
        return ended
    report(found)
    return end


def _searching_edges(calibrator: C, onward: Progress) -> Computation[C]:
    """The searches with edges of unknown times, each with them where the one before has found them, until they stay.

    What they have in common beyond a part of a sample is a delay, which is free from then on: no record shows an edge
    before it was, and traces without edges are as late.
    """
    for _ in range(ROUNDS):
        end = yield from calibrator.searching_from(onward)
        progress = end.minimiser.progress
        found = find_edges(end.minimiser.problem, end.minimiser.slopes)
        if end.is_lost() or found.farthest < NEAR_ENOUGH:
            break
        onward = _moving_edges(calibrator, progress, moved(progress.edges, found.late))
    return end


def _moving_edges(calibrator: C, progress: Progress, edges: Late) -> Progress:
    """The search gone on with edges that are so late, and with a free delay where they have one in common."""
    if progress.late:
        return progress.moving_edges(progress.coordinates, True, edges)
    delay, rest = whole_samples(calibrator.task.fit, 0.0, edges)
    coordinates = (*progress.coordinates[:-1], delay / float(calibrator.transform.scale[-1]))
    return progress.moving_edges(coordinates, bool(delay), rest)


def _searching_late(calibrator: C, timely: Progress, report: Report) -> Computation[C]:
    """The search with a free delay of the duty: from the start or, if that gets lost, from where one has ended that
    took the duty for timely."""
    first = first_progress(calibrator.task)
    begin = timely.began or first.coordinates
    again = dataclasses.replace(first, coordinates=begin, late=True, waterfall=timely.waterfall)
    again = dataclasses.replace(again, linear=timely.linear)
    elsewhere = timely.found or timely.coordinates
    ends: list[C] = []
    for coordinates in (again.coordinates, elsewhere):
        first = dataclasses.replace(again, coordinates=coordinates)
        ends.append((yield from calibrator.searching_from(first, report)))
        if not ends[-1].is_lost():
            return ends[-1]
    return min(ends, key=lambda end: end.minimiser.progress.cost)


def _searching_beside(calibrator: C) -> Computation[C]:
    """The best of the searches that begin later or earlier by one scale of the delay, on as long as it gets better.

    Steps whose length divides the delay are the most exact ones, so that the misfit has small minima there. Of 25
    campaigns three ended in one, a sample early and with values of the plunger a hundred standard errors off. What
    is tried is not reported: a fit that is interrupted meanwhile tries all of it again.
    """
    best, ways = calibrator, [] if calibrator.is_lost() else [1.0, -1.0]
    while ways:
        progress = best.minimiser.progress
        beside = np.append(progress.coordinates[:-1], progress.coordinates[-1] + ways[0])
        onward = progress.elsewhere(np.asarray(calibrator.transform.clip(beside)).tolist())
        end = yield from calibrator.searching_from(onward)
        if not end.is_lost() and best.worth(progress.cost - end.minimiser.progress.cost):
            best, ways = end, ways[:1]  # no use in going back
        else:
            ways = ways[1:]
    return best

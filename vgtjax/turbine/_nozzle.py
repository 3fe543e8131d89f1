"""Volute, pivoted vanes and wheel: a passage for every angle of the vanes, and the moment of the gas on one of them."""

import functools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from .._errors import InputError, is_traced, require_positive
from .._types import Scalar, Values
from ..parameters import Part, nested, parameter
from ._gas import Gas
from ._losses import AbstractLoss, Angles, Blading, GivenLoss
from ._passage import Inlet, Passage
from ._rotor import Rotor, smooth_step
from ._steady import PassageFlow

Yes = Bool[Array, "..."]
CELLS = 224
"""Of a passage: the moment on a vane needs 64 in its row."""
SHARES = (16, 32, 12, 44, 8)
"""Of the cells in volute, vanes, gap, wheel and duct."""
VANES = 1
"""Number of the row of vanes."""
WHEEL = 2
"""Number of the wheel's row."""
SIZES = (
    "pivot_radius",
    "lead",
    "trail",
    "height",
    "volute_radius",
    "volute_ratio",
    "loading_length",
    "turning_share",
)
"""What must not be zero; vanes may be as thin as one likes."""
LEAST_COSINE, MOST_COSINE = 1e-3, 0.999
"""Of the flow angle behind the vanes, whatever geometry a fit tries; at the first the throat is closed."""


class Losses(Part):
    """Losses of the vanes and of the wheel."""

    place = "losses"
    vanes: AbstractLoss = eqx.field(default_factory=lambda: GivenLoss(0.08))
    rotor: AbstractLoss = eqx.field(default_factory=lambda: GivenLoss(0.25))


class Nozzle(Part):
    """A ring of straight vanes on pivots between volute and wheel. No source gives its sizes: all are assumed.

    Angles of the vanes are from the tangent of the ring of pivots: small when closed. With the defaults the force is
    largest with the vanes open, though the thesis (3.6) says that it is with the vanes closed.

    **Raises:** `InputError` for sizes that are not positive.
    """

    place = "nozzle"
    vanes: int = eqx.field(static=True, default=11)
    pivot_radius: Scalar = parameter(25.5e-3, symbol="r_p", unit="m", source="assumed", held=True)
    lead: Scalar = parameter(7.0e-3, symbol="c_l", unit="m", source="assumed", held=True)
    """From the leading edge to the pivot; a fit of loops moves this one."""
    trail: Scalar = parameter(7.6e-3, symbol="c_t", unit="m", source="assumed", held=True)
    """From the pivot to the trailing edge."""
    thickness: Scalar = parameter(0.3e-3, symbol="t", unit="m", source="assumed", held=True)
    height: Scalar = parameter(6.5e-3, symbol="h", unit="m", source="assumed", held=True)
    volute_radius: Scalar = parameter(36e-3, symbol="r_0", unit="m", source="assumed", held=True)
    """Where the gas leaves the volute."""
    volute_ratio: Scalar = parameter(18e-3, symbol="A/R", unit="m", source="assumed", held=True)
    loading_length: Scalar = parameter(0.08, symbol="l_1", unit="-", source="assumed", held=True)
    """Share of the row over which gas takes the vanes' angle; 0.04 to 0.16 are as likely."""
    turning_share: Scalar = parameter(0.7, symbol="xi_t", unit="-", source="assumed", held=True)
    """Share of the row in which the angle goes from the vane's own to that behind it; 0.5 to 0.9 are as likely."""
    rotor: Rotor = eqx.field(default_factory=Rotor)
    losses: Losses = nested(default_factory=Losses)

    def __check_init__(self) -> None:
        self.require_working()

    def require_working(self) -> None:
        """**Raises:** `InputError` as above, for values that were put in later as well."""
        if self.vanes < 3:
            raise InputError(f"nozzle.vanes must be at least 3, but it is {self.vanes}; give the number of vanes")
        for name in SIZES:
            require_positive(f"nozzle.{name}", getattr(self, name), "size", "a nozzle without it lets no gas through")
        self.rotor.require_working()

    def works(self, vane_angle: Values) -> Yes:
        """Whether gas can flow through it with its vanes at an angle in rad, also where that is traced: `passage` and
        `require_range` say why not."""
        sizes = [getattr(self, name) > 0 for name in SIZES]
        laws = [
            self.losses.vanes.valid(*self._vane_row(vane_angle)),
            self.losses.rotor.valid(*self._wheel_row()),
        ]
        return functools.reduce(jnp.logical_and, [self.rotor.works(), *sizes, *laws, *self._room(vane_angle).values()])

    @property
    def pitch(self) -> float:
        """Angle between two vanes, in rad."""
        return 2 * np.pi / self.vanes

    @property
    def chord(self) -> Values:
        """Of a vane, in m."""
        return self.lead + self.trail

    def leading_radius(self, vane_angle: Values) -> Values:
        """Of the leading edges from the axis, in m."""
        return _third_side(self.pivot_radius, self.lead, jnp.sin(vane_angle))

    def trailing_radius(self, vane_angle: Values) -> Values:
        """Of the trailing edges from the axis, in m."""
        return _third_side(self.pivot_radius, self.trail, -jnp.sin(vane_angle))

    def spacing(self, vane_angle: Values) -> Values:
        """Of the trailing edges along their circle, in m."""
        return 2 * jnp.pi * self.trailing_radius(vane_angle) / self.vanes

    def throat(self, vane_angle: Values) -> Values:
        """Width between two vanes, in m."""
        turned = jnp.cos(vane_angle) - jnp.cos(vane_angle + self.pitch)
        return self.pivot_radius * turned - self.trail * math.sin(self.pitch) - self.thickness

    def flow_tangent(self, vane_angle: Values) -> Values:
        """Of the flow angle behind the vanes from the radial direction: its cosine is throat over spacing."""
        cosine = jnp.clip(self.throat(vane_angle) / self.spacing(vane_angle), LEAST_COSINE, MOST_COSINE)
        return jnp.sqrt(1 - cosine**2) / cosine

    def blade_tangent(self, vane_angle: Values) -> Values:
        """Of the vane's own angle from the radial direction at its leading edge."""
        sine = self.pivot_radius * jnp.cos(vane_angle) / self.leading_radius(vane_angle)
        return sine / jnp.sqrt(jnp.maximum(1 - sine**2, 1e-6))

    def inlet(self, total_pressure: Values, total_temperature: Values) -> Inlet:
        """Gas out of the volute: a free vortex, `tan a = 2 pi h / (A/R)`; Pa absolute and K."""
        return Inlet(total_pressure, total_temperature, 2 * jnp.pi * self.height / self.volute_ratio)

    def require_range(self, vane_angle: Values) -> None:
        """**Raises:** `InputError` where vanes at an angle in rad stand across or beyond the tangent, close their
        throat, touch volute or wheel, or of a row whose loss its law does not know."""
        if is_traced(self, vane_angle):
            return
        # A nozzle that is a constant of a function that is traced has values to look at all the same.
        with jax.ensure_compile_time_eval():
            self._require_room(vane_angle)

    def _require_room(self, vane_angle: Values) -> None:
        """See `require_range`."""
        for rule, kept in self._room(vane_angle).items():
            if not bool(kept):
                width = f"{float(self.throat(vane_angle)) * 1e3:.3g} mm"
                raise InputError(f"vanes at {np.degrees(float(vane_angle)):.3g} deg {rule.format(width)}", "nozzle")
        said = f"the vanes at {np.degrees(float(vane_angle)):.3g} deg"
        self.losses.vanes.require_valid(*self._vane_row(vane_angle), said)
        self.losses.rotor.require_valid(*self._wheel_row(), "the wheel")

    def _room(self, vane_angle: Values) -> dict[str, Yes]:
        """What must hold of vanes at an angle in rad, by what is said where it does not."""
        vane_angle = jnp.asarray(vane_angle)
        return {
            "must stand between 0 and 90 deg from the tangent; open them by another angle": (
                (vane_angle > 0) & (vane_angle < np.pi / 2)
            ),
            "have no throat, {}; make them thinner or shorter, or open them": (
                self.throat(vane_angle) > LEAST_COSINE * self.spacing(vane_angle)
            ),
            "reach into the volute; make nozzle.volute_radius larger": (
                self.leading_radius(vane_angle) < self.volute_radius
            ),
            "reach into the wheel; make nozzle.trail shorter": (
                self.trailing_radius(vane_angle) > self.rotor.inlet_radius
            ),
        }

    def passage(self, vane_angle: Values, speed: Values, cells: int = CELLS, gas: Gas | None = None) -> Passage:
        """The passage from the volute to the duct behind the wheel.

        **Arguments:** `vane_angle` in rad; `speed` of the wheel in rad/s; `cells` are shared out over volute, vanes,
        gap, wheel and duct by `SHARES`; `gas` for losses that depend on it.

        While its geometry or the angle is traced, one that does not work makes a passage that turns gas to NaN, through
        which no steady flow is found.

        **Raises:** `InputError` for vanes that close their throat, touch each other's neighbours, or too few cells.
        """
        self.require_range(vane_angle)
        counts = _shared_out(cells)
        rotor = self.rotor
        ring = [
            self.volute_radius,
            self.leading_radius(vane_angle),
            self.trailing_radius(vane_angle),
            rotor.inlet_radius,
        ]
        lengths = [ring[0] - ring[1], ring[1] - ring[2], ring[2] - ring[3], rotor.path, rotor.tail]
        dtype = jnp.result_type(*lengths, speed)
        faces = [jnp.asarray(np.linspace(0, 1, count + 1)[(part > 0) :], dtype) for part, count in enumerate(counts)]
        starts = jnp.concatenate([jnp.zeros(1, dtype), jnp.cumsum(jnp.stack(jnp.broadcast_arrays(*lengths)))])
        m = jnp.concatenate([starts[part] + lengths[part] * faces[part] for part in range(5)])
        radial = jnp.concatenate([ring[part] + (ring[part + 1] - ring[part]) * faces[part] for part in range(3)])
        share, behind = faces[3], jnp.ones(counts[4], dtype)
        radius = jnp.concatenate([radial, rotor.radius(share), rotor.outlet_radius * behind])
        annulus = 2 * jnp.pi * self.height * radial
        area = jnp.concatenate([annulus, rotor.area(share, self.height), rotor.outlet_area * behind])
        row = np.repeat([0, VANES, 0, WHEEL, 0], counts)
        middle = [jnp.asarray((np.arange(count) + 0.5) / count, dtype) for count in counts]
        turned = jnp.where(self.works(vane_angle), self._vane_tangent(vane_angle, middle[1]), jnp.nan)
        wheel = rotor.tangent(middle[3])
        tangent = jnp.zeros(cells, dtype).at[row == VANES].set(turned).at[row == WHEEL].set(wheel)
        length = jnp.where(
            row == VANES,
            self.loading_length * lengths[1],
            jnp.where(row == WHEEL, rotor.loading_length * rotor.path, 1.0),
        )
        gas = Gas() if gas is None else gas
        bare = Passage(
            m,
            radius,
            area,
            row,
            tangent,
            length,
            jnp.where(row == WHEEL, speed, 0.0),
            jnp.zeros(cells, dtype),
            jnp.zeros(cells, dtype),
        )
        losses = {
            VANES: self.losses.vanes.coefficient(*self._vane_row(vane_angle), gas),
            WHEEL: self.losses.rotor.coefficient(*self._wheel_row(), gas),
        }
        friction = sum(_friction(bare, number, zeta) for number, zeta in losses.items())
        return eqx.tree_at(lambda passage: passage.friction, bare, friction)

    def vane_moment(self, passage: Passage, flow: PassageFlow) -> tuple[Values, Values]:
        """Moment of the gas on one vane about its pivot in N m, positive opening, and its normal force in N, positive
        inwards [3.71, corrected].

        The force of the blades on the gas is the pressure difference over the vanes; thickness, stem and end faces are
        left out. A cell's place on the chord is its share of the row.
        """
        inside = jnp.asarray(passage.row) == VANES
        steep = flow.v_u / jnp.where(jnp.abs(flow.v_m) > 1e-9, flow.v_m, 1e-9)
        normal = jnp.where(inside, flow.blade_force * jnp.sqrt(1 + steep**2) / self.vanes, 0.0)
        first = jnp.min(jnp.where(inside, passage.m[:-1], jnp.inf))
        last = jnp.max(jnp.where(inside, passage.m[1:], -jnp.inf))
        share = (passage.centres - first) / (last - first)
        return jnp.sum(normal * (share * self.chord - self.lead)), jnp.sum(normal)

    def _vane_tangent(self, vane_angle: Values, share: Values) -> Values:
        """Of the angle that the vanes turn the gas to, after a share of the row."""
        begin, end = self.blade_tangent(vane_angle), self.flow_tangent(vane_angle)
        return begin + (end - begin) * smooth_step(share / self.turning_share)

    def _vane_row(self, vane_angle: Values) -> tuple[Angles, Blading]:
        angles = [jnp.degrees(jnp.arctan(tangent(vane_angle))) for tangent in (self.blade_tangent, self.flow_tangent)]
        return Angles(*angles), Blading(self.spacing(vane_angle), self.chord, self.height, self.thickness)

    def _wheel_row(self) -> tuple[Angles, Blading]:
        rotor = self.rotor
        spacing = 2 * jnp.pi * rotor.outlet_radius / rotor.blades
        height = rotor.outlet_area / (2 * jnp.pi * rotor.outlet_radius)
        angles = Angles(jnp.zeros_like(rotor.outlet_angle), rotor.outlet_angle)
        return angles, Blading(spacing, rotor.path, height, self.thickness)


def _third_side(first: Values, second: Values, cosine: Values) -> Values:
    """Of two lengths whose sum is square apart by twice a product with this cosine, in m."""
    return jnp.sqrt(first**2 + second**2 + 2 * first * second * cosine)


def _shared_out(cells: int) -> tuple[int, ...]:
    """Cells of each part.

    **Raises:** `InputError` for fewer than two a part.
    """
    ends = np.round(np.cumsum(SHARES) * cells / sum(SHARES)).astype(int)
    counts = tuple(np.diff(ends, prepend=0).tolist())
    if min(counts) < 2:
        raise InputError(f"a nozzle's passage needs at least 28 cells, but it has {cells}; take 112 or more", "cells")
    return counts


def _friction(passage: Passage, number: int, zeta: Values) -> Values:
    """Friction coefficient of a row in 1/m, by which incompressible flow along its blades loses `zeta W_2^2 / 2`."""
    inside = jnp.asarray(passage.row) == number
    area = 0.5 * (passage.area[1:] + passage.area[:-1])
    secant = jnp.sqrt(1 + passage.tangent**2)
    lost = jnp.sum(jnp.where(inside, jnp.diff(passage.m) * secant**3 / area**2, 0.0))
    last = int(np.flatnonzero(np.asarray(passage.row) == number)[-1])
    return jnp.where(inside, zeta * (secant[last] / area[last]) ** 2 / lost, 0.0)

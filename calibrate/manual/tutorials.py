"""The tutorials, gone through as they are printed: `python -m calibrate.manual.tutorials out/tutorials`.

Each gets a folder, in which its studies are written under the names that the page gives them and its commands are run.
Every block of text on the page must be what the command above it says; what is not is named, and the status is 1. Takes
half an hour of a processor; names of tutorials after the folder are those that are gone through.
"""

import pathlib
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import click

from .contributing import ROOT
from .markdown import all_blocks, words_of
from .shown import differences

TUTORIALS = ROOT / "docs" / "tutorials"
COMMAND = ["python", "-m", "calibrate"]
FILE = re.compile(r"`([\w/]+\.toml)`")
TERMINAL = "terminal.txt"
"""What all commands said, in the folder of a tutorial."""
Run = Callable[[list[str], pathlib.Path], str]
"""Runs a command in a folder, and gives what it says."""


def run_alone(words: list[str], folder: pathlib.Path) -> str:
    """In a process of its own; raises `RuntimeError` when that fails."""
    began = time.monotonic()
    done = subprocess.run([sys.executable, *words[1:]], cwd=folder, capture_output=True, text=True)
    print(f"  {time.monotonic() - began:4.0f} s  {' '.join(words)}", flush=True)
    if done.returncode:
        raise RuntimeError(f"{' '.join(words)}: status {done.returncode}: {done.stderr}")
    return done.stdout


def go_through(page: pathlib.Path, folder: pathlib.Path, run: Run = run_alone) -> Iterator[str]:
    """Does what a page says, in an empty folder; gives a sentence for each line that it shows and nobody said."""
    said: str | None = None
    for block in all_blocks(page):
        if block.language == "toml":
            for name in FILE.findall(block.before)[-1:]:  # one without a name only shows how something may be said
                (folder / name).write_text(block.text, encoding="utf-8")
        elif block.language == "bash":
            said = "".join(_do(words, folder, run) for words in words_of(block.text))
            with (folder / TERMINAL).open("a", encoding="utf-8") as terminal:
                terminal.write(f"{block.text}\n{said}\n")
        elif block.language == "text":
            yield from differences(block.text, said or "")


def _do(words: list[str], folder: pathlib.Path, run: Run) -> str:
    if words[:3] == COMMAND:
        return run(words, folder)
    copy, _, source, target = words
    assert copy == "cp", words
    shutil.copytree(ROOT / source, folder / target)
    return ""


def main(out: pathlib.Path, names: list[str]) -> int:
    """All tutorials, or those that are named; gives the exit status."""
    found = 0
    for page in sorted(TUTORIALS.glob("*.md")):
        if not names or page.stem in names:
            print(page.relative_to(ROOT), flush=True)
            folder = out / page.stem
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            for sentence in go_through(page, folder):
                print(sentence, flush=True)
                found += 1
    print(f"{found} lines are not what the commands say" if found else "every line is what the commands say")
    return int(found > 0)


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("out", type=click.Path(path_type=pathlib.Path))
@click.argument("names", type=click.Choice([page.stem for page in sorted(TUTORIALS.glob("*.md"))]), nargs=-1)
def _command(out: pathlib.Path, names: tuple[str, ...]) -> None:
    """Goes through the tutorials, or those that are named, as they are printed; half an hour of a processor for all."""
    sys.exit(main(out, list(names)))


if __name__ == "__main__":
    _command(prog_name="python -m calibrate.manual.tutorials")

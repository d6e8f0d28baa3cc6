"""Faults in whole commands: what came of each, in a table by command and kind.

    python -m tests.faults.run [--count N] [--seconds S] [--seed N] [--only GLOB] [--kind GLOB]

Calls of the C library fail (``shim.c``), processes are killed and told to end, memory is short,
two commands write one folder, pipes close. After each fault the exit code must be one of the
contract with one sentence, every file of the output folder the old one or the new one whole, and
the same command once more must end with the bytes of one that nothing disturbed. The exit code is
1 where that was not so.
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

from tests.faults import scenes_live
from tests.faults.child import MOST_S, Ended, Running, start
from tests.faults.commands import SCENES, Scene, contents, fresh
from tests.faults.judge import unsynced, wrong_end, wrong_files
from tests.faults.shim import FAULTS, Op, arm, log_to, seen, with_library
from tests.faults.warm import warm

TIMED = {
    "killed": signal.SIGKILL,
    "interrupted": signal.SIGINT,
    "ended": signal.SIGTERM,
}
OTHER = ("closed pipe", "two at once", "short of memory")
KINDS = (*FAULTS, *TIMED, *OTHER)
_COMPILED_S = 900.0
"""Of a command that nothing disturbs and that may have to compile its kernels first."""


@dataclass(frozen=True)
class Undisturbed:
    """A scene whose inputs are of version 1: results of version 0 (``old``) and 1 (``new``),
    operations by kind and seconds; ``unsafe``: files that got their name before their bytes."""

    scene: Scene
    folder: Path
    old: dict[str, bytes]
    new: dict[str, bytes]
    count: dict[Op, int]
    seconds: float
    unsafe: list[str]

    @property
    def out(self) -> Path:
        return self.folder / "out"

    def words(self) -> list[str]:
        return self.scene.command(self.folder / "in", self.out)

    @property
    def patience_s(self) -> float:
        """After which a command hangs: ten times what it takes on this machine now."""
        return max(MOST_S, 10.0 * self.seconds)

    def restore(self) -> None:
        """The output folder as the run before left it."""
        shutil.rmtree(self.out, ignore_errors=True)
        if self.scene.keeps:
            shutil.copytree(self.folder / "old", self.out)


def undisturbed(name: str, folder: Path) -> Undisturbed:
    """Run both versions of a scene; raises RuntimeError where one fails by itself."""
    scene, old = SCENES[name], {}
    made = Undisturbed(scene, folder, {}, {}, {}, 0.0, [])
    log = folder / "log"
    for version in (0, 1):
        scene.make(fresh(folder / "in"), version)
        if version == 0 and not scene.keeps:
            continue
        made.restore() if version else fresh(made.out)
        ended = _logged(made, log).wait(_COMPILED_S)
        if ended.code:
            raise RuntimeError(f"{name} fails by itself: {ended.err}")
        if version == 0:
            old = contents(made.out, scene.told)
            shutil.copytree(made.out, folder / "old", dirs_exist_ok=True)
    new = contents(made.out, scene.told)
    count = {op: seen(op) for op in Op}
    unsafe = unsynced(log.read_text())
    return Undisturbed(scene, folder, old, new, count, ended.seconds, unsafe)


def _logged(made: Undisturbed, log: Path) -> Running:
    arm(made.folder, Op(0))

    def before() -> None:
        log_to(os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC))
        arm(made.folder, Op.files() | Op.CLOCK)

    # the counters lie in memory that both processes have
    return start(made.words(), before)


def fault(case: Undisturbed, kind: str, draw: random.Random) -> tuple[str, str]:
    """Put one fault into a command: what came of it in a word, and what is wrong or nothing."""
    case.restore()
    first = _disturbed(case, kind, draw)
    ended, others = first[0], first[1:]
    dead = ended.code == -signal.SIGKILL or any(e.code == -signal.SIGKILL for e in others)
    # nor can a folder be tidied that is not there any more
    dead |= kind == "share gone"
    killed = kind.startswith("killed")
    for each in first:
        if said := wrong_end(each, killed):
            return "wrong", said
    said = wrong_files(case.out, case.old, case.new, case.scene.told, dead)
    # a results file that cannot be read is told of and left out of the map
    if said and not (ended.code == 0 and "is left out" in ended.err):
        return "wrong", f"{said}; {ended.err.strip()[-200:]}"
    if not case.scene.keeps and case.out.exists():
        if contents(case.out, case.scene.told) != case.new:
            return "wrong", "a folder that is new is there in part"
        return _word(ended), ""
    again = start(case.words()).wait(case.patience_s)
    if said := wrong_end(again, False) or (f"code {again.code}" if again.code else ""):
        return "wrong", f"once more: {said} {again.err.strip()[:200]}"
    now = contents(case.out, case.scene.told)
    if now != case.new:
        names = sorted(k for k in now.keys() | case.new.keys() if now.get(k) != case.new.get(k))
        return "wrong", f"once more: {', '.join(names[:3])} differ"
    return _word(ended), ""


def _word(ended: Ended) -> str:
    words = {0: "done", 130: "interrupted", -signal.SIGKILL: "killed"}
    return words.get(ended.code, "told")


def _disturbed(case: Undisturbed, kind: str, draw: random.Random) -> list[Ended]:
    words, before = case.words(), _before(case, kind, draw)
    if kind in TIMED:
        # from the first moment to one after the end
        wait = draw.uniform(0.0, 1.1 * case.seconds)
        running = start(words)
        time.sleep(wait)
        running.signal(TIMED[kind])
        return [running.wait(case.patience_s)]
    if kind == "two at once":
        running = start(words)
        time.sleep(draw.uniform(0.0, 0.5 * case.seconds))
        other = start(words)
        return [running.wait(case.patience_s), other.wait(case.patience_s)]
    return [start(words, before).wait(case.patience_s)]


def _before(case: Undisturbed, kind: str, draw: random.Random) -> Callable[[], None]:
    """What the process does to itself before the command."""
    if kind in FAULTS:
        made = FAULTS[kind]
        most = sum(case.count[op] for op in Op if op in made.ops)
        at = draw.randint(1, max(most, 1))
        return lambda: arm(case.folder, made.ops, made.how, made.what, at)
    if kind == "closed pipe":
        return _closed_pipe
    if kind == "short of memory":
        spare = draw.choice((64, 192, 288, 400, 600)) << 20
        return lambda: _limit_memory(spare)
    return lambda: None


def _closed_pipe() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    os.dup2(writer, 1)


def _limit_memory(spare: int) -> None:
    used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    resource.setrlimit(resource.RLIMIT_AS, (used + spare, resource.RLIM_INFINITY))


def drawn(names: list[str], kinds: list[str], count: int, seed: int) -> list[tuple[str, str]]:
    """Pairs of command and kind: every pair once before one comes again, in random order."""
    draw = random.Random(seed)
    out: list[tuple[str, str]] = []
    while len(out) < count:
        pairs = [
            (name, kind)
            for name in names
            for kind in kinds
            if not (name in scenes_live.LIVE and kind in OTHER)
        ]
        draw.shuffle(pairs)
        out += pairs
    # cases of one command together: its undisturbed runs are made once
    return sorted(out[:count], key=lambda pair: names.index(pair[0]))


def inject(
    cases: list[tuple[str, str]], seed: int, work: Path, seconds: float = float("inf")
) -> tuple[Counter[tuple[str, str, str]], list[str]]:
    """Outcomes by command, kind and word; and what went wrong, a line each."""
    table: Counter[tuple[str, str, str]] = Counter()
    wrong: list[str] = []
    made: dict[str, Undisturbed] = {}
    end = time.monotonic() + seconds
    for number, (name, kind) in enumerate(cases):
        if time.monotonic() > end:
            break
        draw = random.Random(f"{seed} {number} {name} {kind}")
        if name in scenes_live.LIVE:
            word, said = scenes_live.LIVE[name](kind, draw, fresh(work / name))
        else:
            if name not in made:
                made[name] = undisturbed(name, fresh(work / name.replace(" ", "-")))
                wrong += [f"{name}: {text} is not synced" for text in made[name].unsafe]
            word, said = fault(made[name], kind, draw)
        table[name, kind, word] += 1
        if said:
            wrong.append(f"{name}, {kind} (number {number}): {said}")
        # a run that is cut off still gives its figures
        print(f"{number}: {name}, {kind}: {word} {said}".rstrip(), flush=True)
    return table, wrong


def as_markdown(table: Counter[tuple[str, str, str]]) -> str:
    """Kinds down, commands across; a cell is how many, and how many of them went wrong."""
    names = list(dict.fromkeys(name.split()[0] for name in SCENES))
    names += [name for name in scenes_live.LIVE if name not in names]
    names = [name for name in names if any(key[0].split()[0] == name for key in table)]
    lines = ["| fault | " + " | ".join(names) + " | all |", "|---|" + "---|" * (len(names) + 1)]

    def cell(kind: str, name: str) -> str:
        of = {
            k: n for k, n in table.items() if kind in ("", k[1]) and name in ("", k[0].split()[0])
        }
        wrong = sum(n for k, n in of.items() if k[2] == "wrong")
        return f"{sum(of.values())}" + (f" ({wrong} wrong)" if wrong else "")

    for kind in [kind for kind in KINDS if any(key[1] == kind for key in table)]:
        lines.append(f"| {kind} | " + " | ".join(cell(kind, name) for name in [*names, ""]) + " |")
    lines.append("| all | " + " | ".join(cell("", name) for name in [*names, ""]) + " |")
    words: Counter[str] = Counter()
    for (_, _, word), n in table.items():
        words[word] += n
    return "\n".join(lines) + "\n\n" + ", ".join(f"{n} {word}" for word, n in words.most_common())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="*")
    parser.add_argument("--kind", default="*")
    args = parser.parse_args()
    with_library("tests.faults.run")
    names = [name for name in [*SCENES, *scenes_live.LIVE] if fnmatch(name, args.only)]
    kinds = [kind for kind in KINDS if fnmatch(kind, args.kind)]
    warm(tuple(name for name in ("run", "calibrate") if name in names))
    with tempfile.TemporaryDirectory(prefix="faults") as folder:
        cases = drawn(names, kinds, args.count, args.seed)
        table, wrong = inject(cases, args.seed, Path(folder).resolve(), args.seconds)
    print(as_markdown(table))
    print("\n".join(wrong))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())

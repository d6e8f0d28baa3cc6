"""What a command prints, and who reads it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.cli.streams import Outlasting

ROOT = Path(__file__).parents[2]
PROGRAM = "import sys; from pipeline.cli import main; main(sys.argv[1:])"


def automap(*words: str, stdout: int) -> subprocess.CompletedProcess[str]:
    """A command whose output goes to a file descriptor."""
    return subprocess.run(
        [sys.executable, "-c", PROGRAM, *words],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )


@pytest.mark.slow
def test_a_run_outlasts_the_reader_of_its_output(tmp_path: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    out = tmp_path / "out"
    done = automap("run", "data/sample-drive", "-o", str(out), "--to", "ingest", stdout=write)
    os.close(write)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert (out / "run.json").is_file()


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_output_that_cannot_be_written_is_told() -> None:
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        done = automap("check", "data/sample-drive", stdout=full.fileno())
    assert done.returncode == 4
    assert "No space left on device" in done.stderr
    assert "unexpectedly" not in done.stderr


def test_after_the_reader_text_goes_nowhere_without_an_error() -> None:
    read, write = os.pipe()
    with os.fdopen(write, "w", encoding="utf-8") as stream:
        out = Outlasting(stream)
        assert out.write("read\n") == 5
        out.flush()
        os.close(read)
        for _ in range(3):
            assert out.write("lost\n") == 5
            out.flush()
        assert out.encoding == "utf-8"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_in_the_last_moments_is_not_the_exit_code(number: signal.Signals) -> None:
    # Python has called what is to be called at exit, and goes on taking things down
    program = (
        "import atexit, os, time\n"
        "from pipeline.cli import root\n"
        f"late = lambda: (os.kill(os.getpid(), {int(number)}), time.sleep(0.2), print('late'))\n"
        "root.run_command = lambda words: atexit.register(late) and 0\n"
        "root.main(['--version'])\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "late\n", "")


def test_a_compiled_librarys_thread_cannot_abort_the_end() -> None:
    # what holds the interpreter's lock while it is taken down is ended where it stands
    program = (
        "import os\n"
        "from pipeline.cli import root\n"
        "class Held:\n"
        "    def __del__(self): os.abort()\n"
        "held = Held()\n"
        "def printed(words):\n"
        "    print('done', end='')\n"
        "    return 3\n"
        "root.run_command = printed\n"
        "root.main(['--version'])\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (3, "done", "")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_before_the_command_has_begun_is_told(number: signal.Signals) -> None:
    program = (
        "import os\n"
        "from pipeline.cli import root\n"
        f"root.outlast_readers = lambda: os.kill(os.getpid(), {int(number)})\n"
        "root.main(['run', 'nothing'])\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr == "interrupted; the same command resumes\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_when_the_command_is_done_is_not_the_exit_code(number: signal.Signals) -> None:
    program = (
        "import os\n"
        "from pipeline.cli import root\n"
        "end = root.uninterruptible\n"
        "def late():\n"
        "    root.uninterruptible = end\n"
        f"    os.kill(os.getpid(), {int(number)})\n"
        "root.uninterruptible = late\n"
        "root.run_command = lambda words: 3\n"
        "root.main(['--version'])\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (3, "")


def test_a_second_interrupt_ends_like_the_first() -> None:
    program = (
        "from pipeline.cli import root\n"
        "def twice(words):\n"
        "    raise KeyboardInterrupt\n"
        "root.run_command = twice\n"
        "root.main(['--version'])\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "")

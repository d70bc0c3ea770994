"""Commands end when they are interrupted, their workers end with them, and exit code 1 belongs to the verdict alone."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
POISE = [sys.executable, "-W", "ignore", str(ROOT / "cli.py")]
BROKEN = ["report", "slope", "--law", "pd", "--gains", "3500,1200"]

PARENT = """
import os, sys, time
from design.workers import processes
if __name__ == "__main__":
    with processes(2, start=sys.argv[1]) as pool:
        futures = [pool.submit(time.sleep, 120) for _ in range(2)]
        print(*pool._processes, flush=True)
        futures[0].result()
"""


def _alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").split(")")[1].split()[0] != "Z"
    except OSError:
        return False


def _none_left(pids, seconds):
    deadline = time.monotonic() + seconds
    while any(map(_alive, pids)) and time.monotonic() < deadline:
        time.sleep(0.05)
    return [pid for pid in pids if _alive(pid)]


def _of_session(session):
    """The living processes of a session."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and _alive(entry.name):
            try:
                if os.getsid(int(entry.name)) == session:
                    found.append(int(entry.name))
            except OSError:
                pass
    return found


linux = pytest.mark.skipif(sys.platform != "linux", reason="processes are counted in /proc")


@linux
@pytest.mark.parametrize("start", ["spawn", "quick"])
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGHUP, signal.SIGTERM])
def test_workers_end_with_their_parent_however_it_ends(tmp_path, start, end):
    script = tmp_path / "parent.py"
    script.write_text(PARENT, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen([sys.executable, str(script), start], stdout=subprocess.PIPE, env=environment) as parent:
        workers = [int(pid) for pid in parent.stdout.readline().split()]
        assert len(workers) == 2
        parent.send_signal(end)
    assert _none_left(workers, 20) == []


COMMANDS = {
    "synthesize": ["synthesize", "slope"],
    "prove": ["prove", "slope"],
    "report": ["report", "slope", "-o", "page.html"],
    "tradeoff": ["tradeoff", "slope", "--between", "contact-force", "decay-rate"],
    "study": ["study", "slope-step", "--controllers", "force,mpc", "--trials", "400", "--jobs", "2", "-o", "study"],
}


@linux
@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_an_interrupt_at_any_moment_ends_everything_at_once(tmp_path, name):
    draw = random.Random(name)
    for number in range(4):
        folder = tmp_path / str(number)
        folder.mkdir()
        process = subprocess.Popen(
            [*POISE, *COMMANDS[name]], cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
            start_new_session=True,
        )  # fmt: skip
        time.sleep(draw.uniform(0.3, 4.0))  # before that Python itself may be at its start
        for _ in range(number % 2 + 1):  # once, or twice as the impatient do
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGINT)
            time.sleep(0.2)
        _, remarks = process.communicate(timeout=30)
        assert process.returncode in (0, 130), remarks
        assert "Traceback" not in remarks
        assert _none_left(_of_session(process.pid), 10) == []
        for page in folder.glob("*.html"):
            assert page.read_text(encoding="utf-8").rstrip().endswith("</html>")
        assert list(folder.glob(".*.part")) == []


def _code(arguments, **streams):
    return subprocess.run([*POISE, *arguments], check=False, timeout=120, **streams).returncode


def test_a_reader_that_closes_its_pipe_does_not_change_the_verdict():
    reader, writer = os.pipe()
    os.close(reader)
    assert _code(BROKEN, stdout=writer, stderr=subprocess.DEVNULL) == 1
    os.close(writer)


@pytest.mark.parametrize(("arguments", "code"), [(BROKEN, 1), (["report", "slope"], 0), (["report", "nofile"], 2)])
@pytest.mark.parametrize("stream", [">&-", "2>&-", ">&- 2>&-", "2>/dev/full"])
def test_closed_streams_do_not_change_the_exit_code(arguments, code, stream):
    line = " ".join(map(str, [*POISE, *arguments])) + f" >/dev/null {stream}"
    assert subprocess.run(["sh", "-c", line], check=False, capture_output=True, timeout=120).returncode == code


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_a_result_that_cannot_be_written_is_an_error_and_no_verdict():
    with open("/dev/full", "w", encoding="utf-8") as full:
        done = subprocess.run([*POISE, *BROKEN], stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    assert "standard output: cannot be written" in done.stderr


def test_pictures_do_not_depend_on_the_backend_of_a_notebook(tmp_path):
    environment = {**os.environ, "MPLBACKEND": "module://matplotlib_inline.backend_inline"}
    for arguments in (["report", "slope", "-o", "page.html"], ["simulate", "slope", "--plot", "run.png"]):
        done = subprocess.run([*POISE, *arguments], cwd=tmp_path, env=environment, check=False, capture_output=True)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "page.html").stat().st_size > 10_000
    assert (tmp_path / "run.png").stat().st_size > 10_000


@pytest.mark.skipif(os.name != "posix", reason="modes of files")
@pytest.mark.parametrize("mode", [0o600, 0o640, 0o664])
def test_a_file_that_is_replaced_keeps_its_mode(tmp_path, mode):
    target = tmp_path / "report.json"
    target.write_text("x", encoding="utf-8")
    target.chmod(mode)
    assert _code(["report", "slope", "-o", str(target)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) == 0
    assert target.stat().st_mode & 0o777 == mode
    assert target.stat().st_size > 1000


@pytest.mark.parametrize("command", ["report", "synthesize", "simulate", "prove", "trials"])
def test_a_place_that_cannot_be_written_is_known_before_anything_is_computed(tmp_path, command):
    began = time.process_time(), time.monotonic()
    done = subprocess.run(
        [*POISE, command, "everywhere", "-o", str(tmp_path / "missing" / "x.json")], check=False, capture_output=True,
        text=True,
    )  # fmt: skip
    assert done.returncode == 2
    assert "cannot be written" in done.stderr
    assert time.monotonic() - began[1] < 30


def test_output_into_a_file_is_utf_8_whatever_the_locale(tmp_path):
    environment = {**os.environ, "PYTHONIOENCODING": "", "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = subprocess.run([*POISE, "report", "slope", "--format", "json"], env=environment, check=False,
                          capture_output=True)  # fmt: skip
    assert "N² m² s" in done.stdout.decode("utf-8")


def test_an_interrupt_of_which_a_library_makes_another_error_is_an_interrupt():
    from design.present import terminal

    def swallowed():
        try:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(5)
        except KeyboardInterrupt:
            message = "wrong number or type of arguments"
            raise NotImplementedError(message) from None

    assert terminal.ended(swallowed, debug=False, stops=(KeyboardInterrupt,)) == 130

"""Work comes back the same from wherever it runs, and errors come back with it."""

import os
import signal
import subprocess
import sys

import pytest

from design.spec.load import load
from design.workers import THREADS, Here, processes


def _fails():
    message = "as told"
    raise ValueError(message)


def _threads():
    return [os.environ.get(name) for name in THREADS]


@pytest.mark.parametrize("start", ["spawn", "quick"])
def test_workers_give_back_results_and_errors_and_have_one_thread_each(start):
    with processes(1, start=start) as pool:
        assert pool.submit(abs, -3).result() == 3
        assert pool.submit(_threads).result() == ["1"] * len(THREADS)
        with pytest.raises(ValueError, match="as told"):
            pool.submit(_fails).result()
    assert _threads() == [os.environ.get(name) for name in THREADS]


def test_here_is_an_executor_too():
    with Here() as pool:
        assert list(pool.map(abs, [-1, 2])) == [1, 2]
        with pytest.raises(ValueError, match="as told"):
            pool.submit(_fails).result()


def test_where_no_process_may_be_started_the_work_is_done_here(monkeypatch):
    def refused(*_, **__):
        message = "no semaphores"
        raise OSError(message)

    monkeypatch.setattr("design.workers.Workers", refused)
    with processes(2) as pool:
        assert isinstance(pool, Here)


def test_workers_leave_ctrl_c_to_their_parent():
    with processes(1) as pool:
        worker = pool.submit(os.getpid).result()
        os.kill(worker, signal.SIGINT)
        assert pool.submit(os.getpid).result() == worker


def test_a_page_is_the_same_from_another_process(tmp_path):
    from design.analysis.verdict import judge
    from design.present.html import as_html
    from design.present.report import Report
    from design.spec.setting import setting

    source = load("slope")
    problem = setting(source.spec)
    here = as_html(
        Report(
            source=source,
            setting=problem,
            gains=problem.gains,
            verdict=judge(problem, problem.gains, "all", drawn=True),
        )
    )
    page = tmp_path / "page.html"
    subprocess.run([sys.executable, "cli.py", "report", "slope", "-o", str(page)], check=True, capture_output=True)
    assert page.read_text(encoding="utf-8").strip() == here.strip()

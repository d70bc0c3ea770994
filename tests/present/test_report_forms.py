"""Every form of a report says the same, stays within its medium, and asks nothing of anywhere."""

import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import pytest

from design.analysis.verdict import judge, stability_rows
from design.model.laws import Gains
from design.model.limits import Required
from design.model.uncertainty import Spread, Tolerances
from design.present import opening
from design.present.explain import explain, pages
from design.present.html import as_html
from design.present.report import Report, as_json, as_junit, as_markdown, as_text, binding, comparison
from design.present.store import dumps
from design.present.text import Style, painter
from design.spec.load import load, parse
from design.spec.setting import setting

ROOT = Path(__file__).resolve().parents[2]
SOURCE = load("slope")
PAPER = Gains(3500.0, 1200.0, 1.0)
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


def _report(problem=None, gains=PAPER, source=SOURCE, extent="all"):
    problem = problem or setting(source.spec)
    return Report(source=source, setting=problem, gains=gains, verdict=judge(problem, gains, extent, drawn=True))


PAPER_REPORT = _report()


def _needing(**levels):
    problem = setting(SOURCE.spec)
    wishes = {key.replace("_", "-"): Required(level=level, soft=soft) for key, (level, soft) in levels.items()}
    return replace(problem, required={**problem.required, **wishes})


def test_every_row_has_a_page_and_every_page_a_row():
    adapting = stability_rows(replace(PAPER_REPORT.setting, adapt=0.3), PAPER_REPORT.setting.scenarios[0], PAPER)
    assert {row.id for row in (*PAPER_REPORT.verdict.rows, *adapting)} == set(pages())


def test_a_page_fits_the_terminal_and_an_unknown_one_says_what_there_is():
    for row in pages():
        assert max(map(len, explain(row).splitlines())) <= 80
    with pytest.raises(Exception, match="did you mean 'heel-force'"):
        explain("heal-force")


def test_text_fits_80_columns_without_colour_and_says_kept_or_broken():
    broken = _report(_needing(contact_force=(50.0, False)))
    for report in (PAPER_REPORT, broken):
        for line in as_text(report, painter(False)).splitlines():
            assert len(line) <= 80, line
    text = as_text(broken, painter(False))
    rows = [line.split()[0] for line in text.splitlines() if line.startswith(("BROKEN", "KEPT", "INFO"))]
    assert rows == sorted(rows, key=["BROKEN", "KEPT", "INFO"].index)
    assert rows[0] == "BROKEN"
    assert "\033" not in text


def test_no_color_is_respected_on_a_terminal(monkeypatch):
    from design.present import terminal

    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert "\033" in terminal.painter_for_output()("x", Style.BAD)
    monkeypatch.setenv("NO_COLOR", "1")
    assert terminal.painter_for_output()("x", Style.BAD) == "x"


def test_a_broken_soft_requirement_is_shown_and_fails_nothing():
    report = _report(_needing(contact_force=(50.0, True), delay_margin=(0.1, True)))
    assert report.verdict.overall == "met"
    assert "broken*" in as_text(report, painter(False))
    heel = next(row for row in report.verdict.rows if row.id == "heel-force")
    assert heel.status == "violated" and heel.soft


def test_soft_contact_does_not_excuse_lost_contact():
    problem = replace(_needing(contact_force=(50.0, True)), law="pd")
    assert _report(problem, Gains(3500.0, 1200.0, 0.0)).verdict.overall == "violated"


def test_a_row_that_cannot_be_computed_is_undecided_with_the_reason():
    report = _report(_needing(delay_margin=(0.001, False)), Gains(300.0, 1200.0, 1.0))
    row = next(row for row in report.verdict.rows if row.id == "delay-margin")
    assert row.status == "undecided"
    assert "not stable" in row.note


@pytest.mark.parametrize(
    ("key", "level", "kept"),
    [
        ("torque", 37.9, True), ("torque", 37.8, False),
        ("torque_rate", 41.8, True), ("torque_rate", 41.6, False),
        ("friction", 0.6, True), ("friction", 0.5, False),
        ("settling", 1.2, True), ("settling", 1.1, False),
        ("overshoot", 0.18, True), ("overshoot", 0.17, False),
        ("posture_error", 0.004, True), ("posture_error", 0.0039, False),
        ("gain_margin_up", 1e6, True), ("gain_margin_down", 0.12, True), ("gain_margin_down", 0.11, False),
        ("phase_margin", 88.0, True), ("phase_margin", 89.0, False),
        ("delay_margin", 0.0096, True), ("delay_margin", 0.0097, False),
        ("force_delay_margin", 1.05, True), ("angle_delay_margin", 0.0088, False),
        ("disk_margin", 1.5, True), ("disk_margin", 1.6, False),
        ("sample_time", 0.012, True), ("sample_time", 0.013, False),
        ("step_slope", 7.0, True), ("step_slope", 7.1, False),
        ("push", 0.38, True), ("push", 0.39, False),
        ("slope_rate", 7.5, True), ("slope_rate", 7.6, False),
    ],
)  # fmt: skip
def test_each_requirement_is_judged(key, level, kept):
    verdict = judge(_needing(**{key: (level, False)}), PAPER)
    rows = [row for row in verdict.rows if row.id == key.replace("_", "-")]
    assert rows and all(row.required == level for row in rows)
    assert (verdict.overall == "met") is kept


def test_json_is_strict_and_has_the_rows_of_the_full_report():
    other = _report(gains=Gains(3500.0, 902.6, 8.457))
    data = json.loads(dumps(as_json(PAPER_REPORT, other)), parse_constant=pytest.fail)
    assert {row["id"] for row in data["rows"]} == set(pages()) - {"adapt-time"}
    assert data["against"]["gains"]["kd"] == 902.6
    for row in data["rows"]:
        assert {
            "id",
            "equation",
            "scenario",
            "unit",
            "value",
            "required",
            "margin",
            "status",
            "time_s",
            "basis",
        } <= set(row)
        assert row["status"] in ("met", "violated", "undecided")


def test_junit_counts_failures_as_broken_hard_rows():
    report = _report(_needing(contact_force=(50.0, False), disk_margin=(1.7, True)))
    suite = ElementTree.fromstring(as_junit(report)).find("testsuite")
    failed = [case.get("name") for case in suite.iter("testcase") if case.find("failure") is not None]
    assert failed == ["heel-force"]
    assert suite.get("tests") == str(len(report.verdict.rows))
    assert suite.get("failures") == "1"


def test_comparison_says_which_is_better_and_stays_readable():
    other = _report(gains=Gains(3500.0, 902.6, 8.457))
    text = comparison(PAPER_REPORT, other, ("paper", "best"), painter(False))
    found = {line.split()[0]: line.split()[-1] for line in text.splitlines() if line and line[0].islower()}
    assert found["heel-force"] == "B"
    assert found["step-slope"] == "A"  # what the ramp-optimal gains pay
    assert found["friction"] == "A"
    assert max(map(len, text.splitlines())) <= 80


def test_binding_rows_are_marked():
    force = next(row.value for row in PAPER_REPORT.verdict.rows if row.id == "heel-force")
    report = _report(_needing(contact_force=(force - 1e-3, False)), extent="required")
    assert [row.id for row in binding(report.verdict.rows)] == ["heel-force"]


class _Links(HTMLParser):
    """Collects what a browser would fetch, and tags that should not be there."""

    def __init__(self):
        super().__init__()
        self.fetched, self.tags = [], set()

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        for name, value in attrs:
            if name in ("src", "srcset", "data", "poster") or (name in ("href", "xlink:href") and tag != "a"):
                if value and not value.startswith(("#", "data:")):
                    self.fetched.append((tag, name, value))


def test_html_fetches_nothing_and_escapes_the_spec():
    evil = SOURCE.text.replace('source = "', 'source = "<script>alert(1)</script><img src=x> ')
    page = as_html(_report(source=parse(evil, origin="evil.toml")))
    links = _Links()
    links.feed(page)
    assert links.fetched == []
    assert not links.tags & {"script", "img", "iframe", "object", "embed"}
    assert "&lt;script&gt;" in page
    assert not re.search(r"url\(\s*['\"]?https?:|@import", page)


def test_html_shades_what_is_broken_and_draws_the_level():
    page = as_html(_report(replace(setting(SOURCE.spec), law="pd"), Gains(3500.0, 1200.0, 0.0)))
    assert 'id="verdict">BROKEN<' in page
    assert "at least 0" in page


def test_markdown_escapes_and_has_a_line_a_row():
    evil = SOURCE.text.replace('name = "ramp"', 'name = "ramp_1 -"')
    text = as_markdown(_report(source=parse(evil, origin="evil.toml")))
    assert text.count("\n| ") == len(PAPER_REPORT.verdict.rows) + 1
    assert "ramp\\_1" in text


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed: the page is not driven in a browser")
@pytest.mark.parametrize(("width", "dark"), [(400, False), (1200, True)])
def test_a_browser_shows_the_page_without_sideways_scrolling(tmp_path, width, dark):
    page = tmp_path / "report.html"
    probe = (
        "<p id=probe></p><script>document.getElementById('probe').textContent = JSON.stringify({"
        "wide: document.documentElement.scrollWidth - document.documentElement.clientWidth,"
        "verdict: document.getElementById('verdict').textContent,"
        "pictures: [...document.querySelectorAll('figure svg')]"
        ".filter(s => s.getBoundingClientRect().width > 100).length,"
        "asked: performance.getEntriesByType('resource').length,"
        "dark: matchMedia('(prefers-color-scheme: dark)').matches,"
        "ink: getComputedStyle(document.body).color})</script></body>"
    )
    text = as_html(PAPER_REPORT).replace("default-src 'none'", "default-src 'none'; script-src 'unsafe-inline'")
    page.write_text(text.replace("</body>", probe), encoding="utf-8")
    command = [
        CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
        "--disable-background-networking", "--disable-component-update", "--disable-sync",
        f"--user-data-dir={tmp_path / 'profile'}", f"--window-size={width},900", "--dump-dom",
        *(["--blink-settings=preferredColorScheme=0"] if dark else []), page.as_uri(),
    ]  # fmt: skip
    shown = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
    found = json.loads(re.search(r'<p id="?probe"?>(\{.*?\})</p>', shown).group(1).replace("&amp;", "&"))
    assert found["verdict"] == "KEPT"
    assert found["wide"] <= 0
    assert found["pictures"] == 6
    assert found["asked"] == 0
    assert found["dark"] is dark
    red = int(re.match(r"rgb\((\d+)", found["ink"]).group(1))
    assert (red > 128) is dark


def test_a_report_says_what_is_proved_for_which_box_under_which_assumptions():
    tolerant = replace(setting(SOURCE.spec), tolerances=Tolerances(ell=Spread(part=0.005)))
    proved = opening.proved(_report(tolerant), 60.0)
    rows = {row.id: row for row in proved.verdict.rows}
    for id in ("stiffness", "damping", "routh", "decay-rate", "toe-force", "heel-force", "cop-margin"):
        assert rows[id].basis == "proved"
    assert rows["friction"].basis == "sampled"
    sampled = {row.id: row for row in PAPER_REPORT.verdict.rows}
    assert 0 < rows["heel-force"].value < sampled["heel-force"].value
    said = " ".join(as_text(proved, painter(False)).split())
    assert "PROVED heel-force" in said
    assert "half length 0.0995 to 0.1005 m" in said
    assert "no delay" in said
    assert max(map(len, as_text(proved, painter(False)).splitlines())) <= 80
    assert "half length 0.0995 to 0.1005 m" in as_html(proved)
    alone = _report(setting(SOURCE.spec).with_law("pd"), Gains(3500.0, 1200.0, 0.0))
    assert "DISPROVED: heel-force" in " ".join(as_text(opening.proved(alone, 60.0), painter(False)).split())

"""A study's page says what the rows say, marks what is broken, and asks nothing of anywhere."""

import json
import math
import re
import shutil
import subprocess
from html.parser import HTMLParser

import pytest

from design.present.study_html import COMPARED, as_html, differences, findings, headline
from design.present.study_plots import MOST, chosen
from design.present.study_text import as_text
from design.present.text import painter
from problems.comparison.summary import summary

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
TEN = (
    "pd", "force", "cop", "pd-synthesized", "force-synthesized", "cop-synthesized", "mpc", "nmpc", "mpc-oracle",
    "mpc-preview",
)  # fmt: skip
THREE = ("force", "force-synthesized", "mpc")
LONG = "a slope that tilts as in Fig. 5, then a gust, and then_another_word_without_any_space_in_it_at_all_" + "x" * 60


def _trial(controller, scenario, trial, force, **changed):
    """A trial in which the heel force sinks to ``force`` [N]."""
    lost = force is not None and force < 0
    times = [0.05 * k for k in range(60)]
    varies = 1.0 + 0.1 * math.sin(7.0 * (trial or 0) + len(controller))
    row = {
        "controller": controller, "scenario": scenario, "trial": trial, "status": "lost" if lost else "kept",
        "why": "", "lost_s": 2.95 if lost else None, "lost_at": "heel" if lost else None, "fallen_s": None,
        "toe_force_n": 200.0, "heel_force_n": force, "contact_force_n": force, "cop_margin_m": 0.01 * varies,
        "settling_s": None if lost else varies, "posture_error_deg": None if lost else 0.1 * varies,
        "torque_rms_nm": 20.0 * varies,
        "torque_peak_nm": 40.0, "torque_variation_nm": 900.0 * varies, "steps": 60, "tail_steps": 0, "law_steps": 0,
        "seconds": {"median_ms": 0.3, "p99_ms": 0.6, "max_ms": 2.0},
        "trace": {
            "t_s": times, "theta_deg": [-math.sin(t) for t in times], "toe_force_n": [250.0 + t for t in times],
            "heel_force_n": [force + 80 * (2.95 - t) if force is not None else None for t in times],
            "torque_nm": [None] * 60,
        },
    }  # fmt: skip
    if trial:
        del row["trace"]
    return {**row, **changed}


def _crashed(controller, scenario, trial, why="its worker ended, twice"):
    return {"controller": controller, "scenario": scenario, "trial": trial, "status": "crashed", "why": why}


def _survived(names):
    return [
        {"controller": name, "scenario": what, "trial": None, "status": "found", "survived": 1.0 + k / 9, "limit": 3.0}
        for what in ("step-slope", "push")
        for k, name in enumerate(names)
    ]


def _rows(names=THREE, scenarios=("ramp",), trials=4):
    """The first controller loses contact in every trial, the others do not."""
    return _survived(names) + [
        _trial(name, scenario, k, 30.0 * n + 5 * math.sin(k * (1 + 0.1 * n)) - 6.0)
        for k in range(trials)
        for scenario in scenarios
        for n, name in enumerate(names)
    ]


TUNING = {
    "objective": {"id": "contact-force", "unit": "N", "sense": "maximise", "measure": "contact_force_n"},
    "instead_of": "decay-rate",
    "weights": {
        "mpc": {"torque_weight": 9.3, "rate_weight": 0.02, "fixed": ["rate_weight"], "tuned_with": "mpc",
                "evaluations": 21, "value": 121.7, "value_before": 95.3},
    },
    "gains": {"force": {"value": 82.84, "surveyed": 0, "starts": 0}},
}  # fmt: skip


def _document(rows, scenarios=("ramp",), **changed):
    controllers = summary(rows, "force")
    return {
        "schema_version": 1, "command": "study", "spec": {"name": "tilt", "sha256": "ab" * 32}, "status": "complete",
        "trials": 1 + max((row["trial"] or 0 for row in rows), default=0), "seed": 3, "control_period_s": 0.005,
        "scenarios": list(scenarios), "reference": "force", "left_out": {}, "remark": "",
        "gains": {"force": {"kp": 3500.0, "kd": 1200.0, "kf": 1.0}}, "controllers": controllers, "tuning": TUNING,
        "provenance": {"poise": "0.1.0", "numpy": "2.0"}, **changed,
    }  # fmt: skip


def _page(rows, scenarios=("ramp",), **changed):
    return as_html(_document(rows, scenarios, **changed), rows)


class _Read(HTMLParser):
    """Collects what a browser would fetch, the tags, and the text of each table's rows."""

    def __init__(self, page):
        super().__init__()
        self.fetched, self.tags, self.tables, self._table = [], [], {}, None
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag == "table":
            self._table = self.tables.setdefault(dict(attrs)["id"], [])
        elif tag == "tr" and self._table is not None:
            self._table.append("")
        for name, value in attrs:
            outside = value and not value.startswith(("#", "data:"))
            if outside and (name in ("src", "srcset", "data", "poster") or name in ("href", "xlink:href")):
                self.fetched.append((tag, name, value))

    def handle_endtag(self, tag):
        self._table = None if tag == "table" else self._table

    def handle_data(self, data):
        if self._table:
            self._table[-1] += f" {data.strip()}"


def test_the_page_fetches_nothing():
    page = _page(_rows())
    assert _Read(page).fetched == []
    assert not re.search(r"url\(\s*['\"]?https?:|@import", page)
    assert "default-src 'none'" in page


def test_hostile_text_is_shown_and_does_nothing():
    evil = "<script>alert(1)</script><img src=http://x.y/z> $\\frac{$ & \"'"
    rows = [*_rows(scenarios=(evil,)), _crashed("force", evil, 4, evil)]
    page = _page(
        rows, (evil,), spec={"name": evil, "sha256": evil}, left_out={"cop": evil}, remark=evil, provenance={evil: evil}
    )
    read = _Read(page)
    assert not {"script", "img", "iframe", "object", "embed"} & set(read.tags)
    assert read.fetched == []
    assert page.count("&lt;script&gt;") > 6
    assert "<script" not in page


def test_a_controller_with_a_formula_for_a_name_is_drawn():
    names = ("force", r"$\frac{$", "<b>&")
    page = _page(_rows(names))
    assert r">$\frac{$</text>" in page.replace("\n", "")
    assert "<b>&" not in page


def test_the_same_rows_give_the_same_bytes():
    rows = _rows()
    assert _page(rows) == _page(json.loads(json.dumps(rows)))


@pytest.mark.parametrize("names", [THREE, TEN])
def test_every_controller_of_the_rows_is_in_the_table_and_in_the_pictures(names):
    page = _page(_rows(names))
    read = _Read(page)
    assert [line.split()[1] for line in read.tables["controllers"][1:]] == list(names)
    for name in names:
        drawn = len(re.findall(rf">{name}</text>", page))
        assert drawn >= 4  # contact force, slope, push, time


def test_a_broken_contact_is_marked_by_a_word_a_cross_and_a_line():
    page = _page(_rows())
    lines = {line.split()[1]: line.split()[0] for line in _Read(page).tables["controllers"][1:]}
    assert lines == {"force": "LOST", "force-synthesized": "KEPT", "mpc": "KEPT"}
    assert "contact lost</text>" in page
    assert sum("heel" in line for line in _Read(page).tables["trouble"]) == 4
    whole = _page([row for row in _rows() if row["controller"] != "force"], reference="mpc")
    assert "contact lost</text>" not in whole
    assert "trouble" not in _Read(whole).tables


def test_the_headline_names_who_kept_contact_and_who_has_the_largest_median():
    said = headline(_document(_rows()))
    assert said.startswith(
        "force lost contact in 4 of 4 trials (ramp 4); force-synthesized and mpc kept contact in all"
    )
    assert headline(_document(_rows())).endswith(" N, with mpc.")
    crashed = [*_rows(), _crashed("mpc", "ramp", 9)]
    assert "; force-synthesized kept contact in all trials" in headline(_document(crashed))
    for mostly in (1, 0):
        lost = [
            _trial("force", "ramp", 0, -1.0),
            _trial("mpc", "ramp", 0, -2.0),
            _trial("mpc", "ramp", 1, mostly - 1.0),
        ]
        lost[2]["status"] = "kept" if mostly else "lost"
        said = headline(_document(lost))
        assert ("most often did mpc, in 1 of 2" in said) == bool(mostly)
        assert ("in any trial" in said) != bool(mostly)
    assert headline(_document([_crashed("force", "ramp", 0)])) == "No trial could be run to its end."


def test_the_title_says_who_lost_contact_beside_whether_the_study_is_complete():
    page = _page(_rows())
    assert re.search(
        r'id="verdict">COMPLETE</span>; <span\s+class="word bad" id="contact">CONTACT LOST by force<', page
    )
    whole = _page([row for row in _rows() if row["controller"] != "force"], reference="mpc")
    assert 'id="contact">CONTACT KEPT in every trial<' in whole
    assert "by every controller" in _page(EDGES["all lost"][0])
    assert 'id="contact"' not in _page([])


def test_the_text_of_every_controller_fits_80_columns_and_says_how_many_trials_settled():
    quick = {"median_ms": 0.0005, "p99_ms": 0.0009, "max_ms": 0.02}
    rows = [{**row, "seconds": quick} if row["trial"] is not None else row for row in _rows(TEN, ("ramp", LONG), 12)]
    lines = as_text(_document(rows, ("ramp", LONG)), painter(False)).splitlines()
    assert max(map(len, lines)) <= 80
    assert next(line for line in lines if line.startswith("pd ")).split()[5] == "0/24"  # all were lost
    assert next(line for line in lines if line.startswith("mpc ")).split()[5] == "24/24"
    heads = [k for k, line in enumerate(lines) if line in ("trials that lost contact", "smallest contact force")]
    assert lines[heads[0]] == "trials that lost contact"
    assert any(re.match(r"  pd +all +0/24 to 24/24", line) for line in lines)


def test_the_page_says_how_weights_were_chosen():
    page = _page(_rows())
    assert "mpc: torque_weight 9.3, rate_weight 0.02: 121.7 N, from 95.3 N with the default weights, in 21" in page
    assert "rate_weight as the spec says" in page
    assert "decay-rate, cannot be read off a run" in page


def test_differences_of_several_scenarios_are_given_for_each_and_lost_trials_come_first():
    scenarios = ("ramp", "gust")
    rows = [
        _trial(name, scenario, k, 30.0 * n + 5 * math.sin(k + len(scenario)) - 6.0)
        for k in range(4) for scenario in scenarios for n, name in enumerate(THREE)
    ]  # fmt: skip
    lines = _Read(_page(rows, scenarios)).tables["differences"][1:]
    assert "trials that lost contact" in lines[0]
    of_mpc = [line for line in lines if "mpc" in line and "smallest contact force" in line]
    assert len(of_mpc) == 3
    for line, where in zip(of_mpc, ("all", *scenarios), strict=True):
        assert f"mpc {where} " in line
        assert line.split()[-1] == "4"  # draws, not draws times scenarios


def test_an_oracle_is_not_offered_as_a_choice():
    said = headline(_document(_rows(("force", "mpc", "mpc-oracle"))))
    assert "with mpc-oracle (it is told the force), and of those told nothing" in said
    assert said.endswith("with mpc.")


def test_findings_give_the_stored_difference_with_its_interval():
    document = _document(_rows())
    stored = document["controllers"]["mpc"]["against"]["contact_force_n"]
    said = next(line for line in findings(document) if line.startswith("mpc against force"))
    assert f"{stored['mean']:+.4g} N" in said
    assert f"{stored['low']:.4g} to {stored['high']:.4g} N" in said
    assert "(4 pairs)" in said
    assert any("sudden slope survived differs" in line and "with force" in line for line in findings(document))


def test_an_interval_that_is_not_available_is_not_invented():
    rows = _rows(trials=1)
    assert all(line["low"] is None for line in differences(_document(rows)))
    assert any("95 % interval not available from 1 pair." in line for line in findings(_document(rows)))
    assert "not available" in _Read(_page(rows)).tables["differences"][1]


def test_an_interval_that_holds_zero_is_said_to():
    rows = [_trial(name, "ramp", k, 10.0 + n * (-1) ** k) for k in range(6) for n, name in enumerate(("force", "mpc"))]
    assert any(", which holds 0 " in line for line in findings(_document(rows)))


def test_of_many_controllers_the_reference_and_the_best_are_drawn():
    controllers = summary(_rows(TEN), "force")
    names = chosen(controllers, "pd")
    assert names == ["pd", *TEN[-MOST + 1 :]]
    page = _page(_rows(TEN))
    assert "the reference, and" in page
    assert "the reference, and" not in _page(_rows())


def _nothing_but(keys):
    return {key: None for key in _trial("force", "ramp", 0, 1.0) if key not in keys}


FIXED = ("controller", "scenario", "trial", "status", "steps", "tail_steps", "law_steps")
EDGES = {
    "one trial": (_rows(trials=1), ("ramp",)),
    "no trace": ([{k: v for k, v in row.items() if k != "trace"} for row in _rows()], ("ramp",)),
    "an empty trace": ([{**row, "trace": {}} for row in _rows()], ("ramp",)),
    "a trace of nothing": (
        [_trial("force", "ramp", 0, None), _trial("mpc", "ramp", 0, None, trace={"t_s": [0.0, 0.1]})], ("ramp",)
    ),
    "all lost": ([_trial(name, "ramp", k, -1.0 - k) for name in THREE for k in range(4)], ("ramp",)),
    "all crashed": ([_crashed(name, "ramp", 0) for name in THREE] + [_crashed("mpc", "push", None)], ("ramp",)),
    "some crashed": ([*_rows(), *[_crashed(name, "ramp", 9) for name in THREE]], ("ramp",)),
    "no survival": ([row for row in _rows() if row["trial"] is not None], ("ramp",)),
    "only survival": ([row for row in _rows() if row["trial"] is None], ("ramp",)),
    "ten, five and long": (_rows(TEN, [f"{LONG} {k}" for k in range(5)], 3), [f"{LONG} {k}" for k in range(5)]),
    "a scenario without rows": (_rows(), ("ramp", "gust")),
    "one controller": (_rows(("force",)), ("ramp",)),
    "None everywhere": (
        [{**_trial(name, "ramp", k, 1.0), **_nothing_but(FIXED)} for name in THREE for k in range(4)], ("ramp",)
    ),
    "no rows": ([], ("ramp",)),
    "no time": ([{**row, "seconds": None} for row in _rows()], ("ramp",)),
    "one sample": ([_trial(n, "ramp", 0, 1.0, trace={"t_s": [0], "theta_deg": [0]}) for n in THREE], ("ramp",)),
    "far below": ([_trial(n, "ramp", k, -1e4 * k) for n in THREE for k in range(4)], ("ramp",)),
}  # fmt: skip


@pytest.mark.parametrize("edge", EDGES)
def test_every_study_has_a_page(edge):
    rows, scenarios = EDGES[edge]
    page = _page(rows, scenarios, status="undecided")
    read = _Read(page)
    table = page[page.index('id="controllers"') : page.index("</table>")]
    names = list(dict.fromkeys(row["controller"] for row in rows))
    assert re.findall(r'<th scope="row">(.*?)</th>', table) == names
    assert ">nan" not in page and "None<" not in page
    assert read.fetched == []
    assert "Trials are missing" in page


def test_the_page_says_how_to_do_the_study_again():
    page = _page(_rows(), left_out={"cop": "the spec gives no gains for this law"})
    assert "poise study SPEC --controllers force,force-synthesized,mpc,cop --trials 4 --seed 3 -o FOLDER" in page
    assert "cop is left out: the spec gives no gains for this law" in page
    assert "ab" * 32 in page and "numpy 2.0" in page


def test_every_measure_with_pairs_is_drawn_and_listed_in_its_unit():
    rows = [_trial(name, "ramp", k, 10.0 + n + k * (1 + 0.1 * n)) for k in range(4) for n, name in enumerate(THREE)]
    page = _page(rows)
    for words, unit, _, better in (each for measure, each in COMPARED.items() if measure != "lost"):  # none was
        assert f"difference [{unit}], {better} is better" in page
        assert sum(words in line and unit in line for line in _Read(page).tables["differences"]) == 2


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed: the page is not driven in a browser")
@pytest.mark.parametrize(("width", "dark"), [(500, False), (1200, True)])
def test_a_browser_shows_the_page_without_sideways_scrolling(tmp_path, width, dark):
    rows, scenarios = EDGES["ten, five and long"]
    page = tmp_path / "report.html"
    probe = (
        "<p id=probe></p><script>document.querySelectorAll('details').forEach(d => d.open = true);"
        "document.getElementById('probe').textContent = JSON.stringify({"
        "wide: document.documentElement.scrollWidth - document.documentElement.clientWidth,"
        "across: document.documentElement.clientWidth,"
        "headline: document.getElementById('headline').textContent.length,"
        "pictures: [...document.querySelectorAll('figure svg')]"
        ".filter(s => s.getBoundingClientRect().width > 300).length,"
        "asked: performance.getEntriesByType('resource').length,"
        "ink: getComputedStyle(document.body).color})</script></body>"
    )
    text = _page(rows, scenarios).replace("default-src 'none'", "default-src 'none'; script-src 'unsafe-inline'")
    page.write_text(text.replace("</body>", probe), encoding="utf-8")
    command = [
        CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
        "--disable-background-networking", "--disable-component-update", "--disable-sync",
        f"--user-data-dir={tmp_path / 'profile'}", f"--window-size={width},900", "--dump-dom",
        *(["--blink-settings=preferredColorScheme=0"] if dark else []), page.as_uri(),
    ]  # fmt: skip
    shown = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
    found = json.loads(re.search(r'<p id="?probe"?>(\{.*?\})</p>', shown).group(1).replace("&amp;", "&"))
    assert found["across"] <= width
    assert found["wide"] <= 0
    assert found["headline"] > 40
    assert found["pictures"] == len(COMPARED) - 1 + 2 * len(scenarios) + 2 + 1  # lost: the same in every pair
    assert found["asked"] == 0
    red = int(re.match(r"rgb\((\d+)", found["ink"]).group(1))
    assert (red > 128) is dark

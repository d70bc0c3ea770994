"""A law chosen on the command line takes from the spec the gains that it needs, and no others."""

from design.spec.load import builtin_text, parse
from design.spec.setting import setting

SLOPE = builtin_text("slope")


def _setting(text):
    return setting(parse(text, origin="mine.toml").spec)


def test_gains_written_for_pd_keep_kf_for_another_law():
    written = SLOPE.replace('kind = "force"            # pd', 'kind = "pd"  # pd')
    problem = _setting(written)
    assert problem.gains.K_f == 0.0
    assert problem.with_law("force").gains.K_f == 1.0


def test_pd_needs_no_kf():
    problem = _setting(SLOPE.replace("kf = 1.0                  # [m/s]\n", ""))
    assert problem.gains is None
    assert problem.with_law("pd").gains == (3500.0, 1200.0, 0.0)

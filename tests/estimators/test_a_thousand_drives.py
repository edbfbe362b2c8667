"""A thousand simulated drives: are the 95 % intervals 95 % wide, and is nothing called known that cannot be? (slow)"""

from __future__ import annotations

import pytest

from levelhead.analysis.montecarlo import monte_carlo

pytestmark = pytest.mark.slow

TILT = slice(0, 2)
GYRO = slice(3, 6)
ACCEL = slice(6, 8)
"""Of `levelhead.analysis.trials.QUANTITIES`; the vertical accelerometer bias is not among the promises."""


def test_intervals_cover_what_they_promise() -> None:
    # Half of the drives each; 500 drives leave 1 % (one sigma) for a bias that is one error per drive.
    for scenario in ("field", "windrower"):
        found = monte_carlo(scenario, 500, ["phasor", "smoother"], duration=600.0)
        for method in ("phasor", "smoother"):
            coverage = found.figures(method).coverage
            for name, part in (("tilt", TILT), ("gyro", GYRO), ("accel", ACCEL)):
                mean = float(coverage[part].mean())
                assert 0.93 <= mean <= 0.97, f"{scenario} {method} {name}: they cover {100 * mean:.1f} %"


@pytest.mark.parametrize("scenario", ["straight", "circle"])
def test_no_run_calls_known_what_cannot_be(scenario: str) -> None:
    found = monte_carlo(scenario, 250, ["observer", "two-stage", "phasor", "smoother", "ekf"], duration=600.0)
    for method, trials in found.trials.items():
        assert not any(trial.accel_flagged for trial in trials), method

"""levelhead: what is wrong with a land vehicle's inertial sensors, from its IMU + GNSS log.

Frames
    Body: x forward, y right, z down (FRD). Navigation: North, East, Down (NED).
Signs
    ``reading = truth + bias``: an estimate is subtracted. Level and at rest the accelerometer reads (0, 0, -g).
Units
    SI and radians. Time in seconds (float64), strictly increasing. NaN means absent.

>>> import levelhead as lh
>>> log, truth = lh.simulate("field", seed=1, duration=600)
>>> result = lh.estimate(log, method="smoother")
>>> result.gyro_bias[-1]        # rad/s, body x, y, z
>>> result.summary()            # a plain dict, as in summary.json
"""

from __future__ import annotations

from levelhead.analysis.estimation import estimate
from levelhead.errors import LevelheadError, LogError, OutputError, UsageError
from levelhead.estimators.base import HeadingSource, ReferencePoint, Result, Status
from levelhead.estimators.ekf import Ekf, EkfParams
from levelhead.estimators.mahony import Mahony, MahonyParams
from levelhead.estimators.observer import Observer, ObserverParams
from levelhead.estimators.params import Initial, NoiseParams
from levelhead.estimators.phasor import Phasor, PhasorParams
from levelhead.estimators.two_stage import TwoStage, TwoStageParams
from levelhead.events import Event
from levelhead.kernel import get_include
from levelhead.logs.log import Log
from levelhead.logs.readers import read
from levelhead.logs.writers import write
from levelhead.preflight import Preflight, Told, check
from levelhead.report.exports import export_calibration
from levelhead.sim import SensorModel, Truth, simulate
from levelhead.version import __version__

__all__ = [
    "Ekf",
    "EkfParams",
    "Event",
    "HeadingSource",
    "Initial",
    "LevelheadError",
    "Log",
    "LogError",
    "Mahony",
    "MahonyParams",
    "NoiseParams",
    "Observer",
    "ObserverParams",
    "OutputError",
    "Phasor",
    "PhasorParams",
    "Preflight",
    "ReferencePoint",
    "Result",
    "SensorModel",
    "Status",
    "Told",
    "Truth",
    "TwoStage",
    "TwoStageParams",
    "UsageError",
    "__version__",
    "check",
    "estimate",
    "export_calibration",
    "get_include",
    "read",
    "simulate",
    "write",
]

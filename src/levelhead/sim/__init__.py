"""Simulated drives with an exactly known truth: `simulate`, the named `SCENARIOS`, and the `SensorModel`."""

from levelhead.sim.outages import Outage, outage_windows, without_gnss
from levelhead.sim.scenarios import SCENARIOS, Scenario
from levelhead.sim.sensors import SensorModel
from levelhead.sim.simulation import ORIGIN_LLH, simulate
from levelhead.sim.truth import PointTruth, Truth

__all__ = [
    "ORIGIN_LLH",
    "SCENARIOS",
    "Outage",
    "PointTruth",
    "Scenario",
    "SensorModel",
    "Truth",
    "outage_windows",
    "simulate",
    "without_gnss",
]

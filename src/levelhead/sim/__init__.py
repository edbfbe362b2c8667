"""Simulated drives with an exactly known truth: `simulate`, the named `SCENARIOS`, and the `SensorModel`."""

from levelhead.sim.scenarios import SCENARIOS, Scenario
from levelhead.sim.sensors import SensorModel
from levelhead.sim.simulation import ORIGIN_LLH, Truth, simulate

__all__ = ["ORIGIN_LLH", "SCENARIOS", "Scenario", "SensorModel", "Truth", "simulate"]

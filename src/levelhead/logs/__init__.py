"""Logs: reading, checking, deriving and writing IMU + GNSS records."""

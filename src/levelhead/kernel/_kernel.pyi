from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray, StatusArray

DEFAULT_GRAVITY: float

_Vector = Sequence[float] | NDArray[np.floating]

class _Stream:
    def update_imu(self, t: float, gyro: _Vector, accel: _Vector) -> bool: ...
    def update_gnss(self, t: float, velocity_ned: _Vector, velocity_std: float | _Vector | None = None) -> bool: ...
    def run(
        self,
        time: FloatArray,
        gyro: FloatArray,
        accel: FloatArray,
        gnss_time: FloatArray,
        velocity_ned: FloatArray,
        velocity_std: FloatArray,
        gyro_bias: FloatArray,
        accel_bias: FloatArray,
        attitude: FloatArray,
        velocity: FloatArray,
        status: StatusArray,
        gyro_bias_std: FloatArray,
        accel_bias_std: FloatArray,
        attitude_std: FloatArray,
        /,
    ) -> int: ...
    def save(self) -> bytes: ...
    @property
    def time(self) -> float: ...
    @property
    def gyro_bias(self) -> FloatArray: ...
    @property
    def accel_bias(self) -> FloatArray: ...
    @property
    def roll(self) -> float: ...
    @property
    def pitch(self) -> float: ...
    @property
    def heading(self) -> float: ...
    @property
    def velocity_ned(self) -> FloatArray: ...
    @property
    def raw_status(self) -> int: ...
    @property
    def raw_events(self) -> list[tuple[str, int, float, float]]: ...
    @property
    def vertical_axis(self) -> int: ...
    @property
    def dcm_body_to_ned(self) -> FloatArray: ...
    @property
    def sigma(self) -> tuple[FloatArray, FloatArray, FloatArray]: ...

class _Steered(_Stream):
    @property
    def residual(self) -> tuple[float, float, float]: ...

class _FixedGain(_Steered):
    def run_recorded(
        self,
        time: FloatArray,
        gyro: FloatArray,
        accel: FloatArray,
        gnss_time: FloatArray,
        velocity_ned: FloatArray,
        velocity_std: FloatArray,
        gyro_bias: FloatArray,
        accel_bias: FloatArray,
        attitude: FloatArray,
        velocity: FloatArray,
        status: StatusArray,
        gyro_bias_std: FloatArray,
        accel_bias_std: FloatArray,
        attitude_std: FloatArray,
        epochs: FloatArray,
        /,
    ) -> int: ...

class _Observer(_FixedGain):
    def __new__(cls, *args: object, **kwargs: object) -> Self: ...
    def __init__(
        self,
        blob: bytes = ...,
        *,
        tau: float = ...,
        tau_heading: float = ...,
        min_course_speed: float = ...,
        gravity: float = ...,
        lever_arm: _Vector = ...,
        tau_gyro: float = ...,
        omega_accel: float = ...,
        paper_gain: bool = ...,
        gyro_bias: _Vector = ...,
        accel_bias: _Vector = ...,
    ) -> None: ...

class _TwoStage(_FixedGain):
    def __new__(cls, *args: object, **kwargs: object) -> Self: ...
    def __init__(
        self,
        blob: bytes = ...,
        *,
        tau: float = ...,
        tau_heading: float = ...,
        min_course_speed: float = ...,
        gravity: float = ...,
        lever_arm: _Vector = ...,
        tau_gyro_lowpass: float = ...,
        tau_accel_lowpass: float = ...,
        straight_rate: float = ...,
        turn_rate: float = ...,
        feedback: bool = ...,
        gyro_bias: _Vector = ...,
        accel_bias: _Vector = ...,
    ) -> None: ...

class _Ekf(_Stream):
    def __new__(cls, *args: object, **kwargs: object) -> Self: ...
    def __init__(
        self,
        blob: bytes = ...,
        *,
        min_course_speed: float = ...,
        gravity: float = ...,
        lever_arm: _Vector = ...,
        gyro_noise: float = ...,
        accel_noise: float = ...,
        gyro_bias_walk: float = ...,
        accel_bias_walk: float = ...,
        velocity_std: float = ...,
        initial_gyro_bias_std: float = ...,
        initial_accel_bias_std: float = ...,
        latitude: float = ...,
        gyro_bias: _Vector = ...,
        accel_bias: _Vector = ...,
    ) -> None: ...
    @property
    def covariance(self) -> FloatArray: ...

class _Mahony(_Steered):
    def __new__(cls, *args: object, **kwargs: object) -> Self: ...
    def __init__(
        self,
        blob: bytes = ...,
        *,
        tau: float = ...,
        tau_heading: float = ...,
        min_course_speed: float = ...,
        gravity: float = ...,
        lever_arm: _Vector = ...,
        tau_gyro: float = ...,
        use_gnss_acceleration: bool = ...,
        gyro_bias: _Vector = ...,
        accel_bias: _Vector = ...,
    ) -> None: ...

class ObserverF64(_Observer): ...
class ObserverF32(_Observer): ...
class TwoStageF64(_TwoStage): ...
class TwoStageF32(_TwoStage): ...

class _Phasor(_Stream):
    def __new__(cls, *args: object, **kwargs: object) -> Self: ...
    def __init__(
        self,
        blob: bytes = ...,
        *,
        min_course_speed: float = ...,
        gravity: float = ...,
        lever_arm: _Vector = ...,
        gyro_noise: float = ...,
        accel_noise: float = ...,
        gyro_bias_walk: float = ...,
        accel_bias_walk: float = ...,
        velocity_std: float = ...,
        sideslip_std: float = ...,
        axle_std: float = ...,
        initial_gyro_bias_std: float = ...,
        initial_accel_bias_std: float = ...,
        latitude: float | None = ...,
        gravity_std: float = ...,
        gyro_bias: _Vector = ...,
        accel_bias: _Vector = ...,
    ) -> None: ...
    @property
    def innovation_ratio(self) -> float: ...

class PhasorF64(_Phasor): ...
class PhasorF32(_Phasor): ...

class SmootherF64:
    def __init__(self, forward: PhasorF64) -> None: ...
    def run(
        self,
        time: FloatArray,
        gyro: FloatArray,
        accel: FloatArray,
        gnss_time: FloatArray,
        velocity_ned: FloatArray,
        velocity_std: FloatArray,
        gyro_bias: FloatArray,
        accel_bias: FloatArray,
        attitude: FloatArray,
        velocity: FloatArray,
        status: StatusArray,
        gyro_bias_std: FloatArray,
        accel_bias_std: FloatArray,
        attitude_std: FloatArray,
        /,
    ) -> int: ...
    def smoothed_start(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray] | None: ...
    def retrace(
        self,
        time: FloatArray,
        gyro: FloatArray,
        accel: FloatArray,
        gyro_bias: FloatArray,
        accel_bias: FloatArray,
        attitude: FloatArray,
        velocity: FloatArray,
        gyro_bias_std: FloatArray,
        accel_bias_std: FloatArray,
        attitude_std: FloatArray,
        /,
    ) -> None: ...
    @property
    def raw_events(self) -> list[tuple[str, int, float, float]]: ...
    @property
    def vertical_axis(self) -> int: ...
    @property
    def innovation_ratio(self) -> float: ...

class EkfF64(_Ekf): ...
class EkfF32(_Ekf): ...
class MahonyF64(_Mahony): ...
class MahonyF32(_Mahony): ...

def observer_covariance(
    epochs: FloatArray,
    leak: FloatArray,
    out: FloatArray,
    *,
    tau: float,
    tau_heading: float,
    gravity: float,
    tau_gyro: float,
    omega_accel: float,
    gyro_noise: float,
    accel_noise: float,
    gyro_bias_walk: float,
    accel_bias_walk: float,
    velocity_std: float,
    initial_gyro_bias_std: float,
    initial_accel_bias_std: float,
) -> None: ...
def two_stage_covariance(
    epochs: FloatArray,
    leak: FloatArray,
    out: FloatArray,
    *,
    tau: float,
    tau_heading: float,
    gravity: float,
    tau_gyro_lowpass: float,
    tau_accel_lowpass: float,
    straight_rate: float,
    turn_rate: float,
    feedback: bool,
    gyro_noise: float,
    accel_noise: float,
    gyro_bias_walk: float,
    accel_bias_walk: float,
    velocity_std: float,
    initial_gyro_bias_std: float,
    initial_accel_bias_std: float,
) -> None: ...

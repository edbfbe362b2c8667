from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray, GnssArrays, ImuArrays, OutArrays

DEFAULT_GRAVITY: float

_Vector = Sequence[float] | NDArray[np.floating]

class _Stream:
    def update_imu(self, t: float, gyro: _Vector, accel: _Vector) -> bool: ...
    def update_gnss(self, t: float, velocity_ned: _Vector, velocity_std: float | _Vector | None = None) -> bool: ...
    def run(self, imu: ImuArrays, gnss: GnssArrays, out: OutArrays, /) -> int: ...
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

class _Navigator(_Stream):
    def update_gnss(
        self,
        t: float,
        velocity_ned: _Vector | None = None,
        velocity_std: float | _Vector | None = None,
        position_llh: _Vector | None = None,
        position_std: float | _Vector | None = None,
    ) -> bool: ...
    @property
    def position_llh(self) -> FloatArray: ...
    @property
    def position_std(self) -> FloatArray: ...
    @property
    def velocity_std(self) -> FloatArray: ...

class _Steered(_Stream):
    @property
    def residual(self) -> tuple[float, float, float]: ...

class _FixedGain(_Steered):
    def run_recorded(self, imu: ImuArrays, gnss: GnssArrays, out: OutArrays, epochs: FloatArray, /) -> int: ...

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
        latitude: float | None = ...,
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
        latitude: float | None = ...,
        gyro_bias: _Vector = ...,
        accel_bias: _Vector = ...,
    ) -> None: ...

class _Ekf(_Navigator):
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
        position_std: float = ...,
        timing_std: float = ...,
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

class _Phasor(_Navigator):
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
        position_std: float = ...,
        timing_std: float = ...,
        sideslip_std: float = ...,
        axle_std: float = ...,
        wheel_std: float = ...,
        rear_axle: _Vector | None = ...,
        initial_gyro_bias_std: float = ...,
        initial_accel_bias_std: float = ...,
        latitude: float | None = ...,
        gravity_std: float = ...,
        earth_rotation: bool = ...,
        find_standstill: bool = ...,
        gyro_bias: _Vector = ...,
        accel_bias: _Vector = ...,
        heading: float | None = ...,
        heading_std: float = ...,
    ) -> None: ...
    def update_wheel(self, speed: float) -> bool: ...
    @property
    def innovation_ratio(self) -> float: ...

class PhasorF64(_Phasor): ...
class PhasorF32(_Phasor): ...

class SmootherF64:
    def __init__(self, forward: PhasorF64) -> None: ...
    def run(self, imu: ImuArrays, gnss: GnssArrays, out: OutArrays, /) -> int: ...
    def smoothed_start(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, float, float] | None: ...
    def retrace(self, imu: ImuArrays, out: OutArrays, /) -> None: ...
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

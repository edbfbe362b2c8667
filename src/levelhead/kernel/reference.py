"""NumPy twin of the kernel: the same estimators written from the equations, slow and obvious, the oracle of the tests.

Nothing here is shared with the header. Where the header is clever (series for small angles, ``C (w - C^T w_p)``, a
matrix re-orthonormalised with one Newton step), this file takes the plain road (Rodrigues' formula with sine and
cosine, one rotation for the body and one for the platform, a singular value decomposition).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from levelhead.conventions import FloatArray

DOWN = np.array([0.0, 0.0, 1.0])


def skew(a: FloatArray) -> FloatArray:
    """Return the matrix [a x] with ``skew(a) @ b == cross(a, b)``."""
    x, y, z = a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation(phi: FloatArray) -> FloatArray:
    """Return exp([phi x]) by Rodrigues' formula; `phi` (3,) in rad."""
    angle = float(np.linalg.norm(phi))
    if angle < 1e-12:
        return np.eye(3) + skew(phi)
    k = skew(phi / angle)
    matrix: FloatArray = np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * k @ k
    return matrix


def nearest_rotation(matrix: FloatArray) -> FloatArray:
    """Return the rotation nearest to a matrix."""
    u, _, vt = np.linalg.svd(matrix)
    nearest: FloatArray = u @ vt
    return nearest


def smallest_rotation(start: FloatArray, goal: FloatArray) -> FloatArray:
    """Return the smallest rotation that carries the direction of `start` on to that of `goal`."""
    axis = np.cross(start, goal)
    along, across = float(start @ goal), float(np.linalg.norm(axis))
    if along < 0.0 and across < -1e-6 * along:
        axis, across = np.array([1.0, 0.0, 0.0]), 1.0
    elif across == 0.0:
        return np.eye(3)
    return rotation(axis / across * np.arctan2(np.linalg.norm(np.cross(start, goal)), along))


def about_down(angle: float) -> FloatArray:
    """Return the rotation of the platform about the vertical that adds `angle` (rad) to the heading."""
    return rotation(DOWN * angle)


def heading_of(dcm_body_to_ned: FloatArray) -> float:
    """Return the heading of an attitude, rad."""
    return float(np.arctan2(dcm_body_to_ned[1, 0], dcm_body_to_ned[0, 0]))


def euler_of(dcm_body_to_ned: FloatArray) -> FloatArray:
    """Return roll, pitch, heading (3,) of an attitude, rad."""
    c = dcm_body_to_ned
    return np.array([np.arctan2(c[2, 1], c[2, 2]), -np.arcsin(np.clip(c[2, 0], -1.0, 1.0)), heading_of(c)])


def wrapped(angle: float) -> float:
    """Return an angle in (-pi, pi]."""
    return float(-((-angle + np.pi) % (2.0 * np.pi) - np.pi))


@dataclass(kw_only=True)
class Platform:
    """The virtual platform of both papers, Eqs. (1)-(3), closed over one GNSS interval at a time."""

    tau: float
    tau_heading: float
    min_course_speed: float
    gravity: float
    lever_arm: FloatArray
    dcm_body_to_ned: FloatArray = field(default_factory=lambda: np.eye(3))
    control_rate_ned: FloatArray = field(default_factory=lambda: np.zeros(3))
    hold: float = 0.0
    rate: FloatArray = field(default_factory=lambda: np.zeros(3))
    dcm_at_epoch: FloatArray = field(default_factory=lambda: np.eye(3))
    velocity: FloatArray | None = None
    delta_velocity: FloatArray = field(default_factory=lambda: np.zeros(3))
    turn: float = 0.0
    aligned: bool = False
    heading_known: bool = False
    reverse: bool = False

    def start(self, specific_force: FloatArray) -> None:
        """Level from one reading: upright or rolled over, whichever is nearer, then the smallest rotation."""
        c = np.diag([1.0, -1.0, -1.0]) if specific_force[2] > 0.0 else np.eye(3)
        self.dcm_body_to_ned = smallest_rotation(c @ specific_force, -DOWN) @ c
        self.new_interval()

    def new_interval(self) -> None:
        """Begin the integrals of an interval."""
        self.dcm_at_epoch = self.dcm_body_to_ned
        self.delta_velocity = np.zeros(3)
        self.turn = 0.0

    def step(self, dt: float, w: FloatArray, f: FloatArray, *, paper_rate: bool) -> None:
        """Eqs. (1) and (2) over one sample: C' = C [w x] - [w_p x] C, and the integral of C f."""
        dt_control = min(dt, self.hold)
        self.hold -= dt_control
        c = self.dcm_body_to_ned
        turned = rotation(-self.control_rate_ned * dt_control) @ c @ rotation(w * dt)
        # Simpson's rule on C(s) f with the attitude turning evenly from c to the end of the step.
        middle = rotation(-self.control_rate_ned * dt_control / 2) @ c @ rotation(w * dt / 2)
        self.delta_velocity = self.delta_velocity + (c + 4.0 * middle + turned) @ f * dt / 6.0
        self.turn += float(w[2] if paper_rate else (c @ w)[2]) * dt
        self.rate = w
        self.dcm_body_to_ned = nearest_rotation(turned)

    def close(self, length: float, usable: bool, velocity: FloatArray, std: float) -> Interval | None:
        """Close an interval: Eq. (3) on velocity increments. Returns None while start-up goes on waiting."""
        v = velocity - self.dcm_body_to_ned @ np.cross(self.rate, self.lever_arm)
        speed = float(np.hypot(v[0], v[1]))
        course = float(np.arctan2(v[1], v[0]))
        trusted = speed > self.min_course_speed and not std > 0.26 * speed
        closed = usable and self.velocity is not None
        was_aligned, knew_heading = self.aligned, self.heading_known
        before = self.velocity if self.velocity is not None else np.zeros(3)
        force = (v - before) / max(length, 1e-6) - self.gravity * DOWN

        if closed and not was_aligned:
            if length < 0.999:
                return None
            c = self.dcm_body_to_ned
            measured = c.T @ self.delta_velocity / length
            for _ in range(6):
                c = about_down(wrapped(course - heading_of(c)) if trusted else 0.0) @ c
                c = smallest_rotation(c @ measured, force) @ c
            self.dcm_body_to_ned = c
            self.aligned, self.heading_known = True, trusted
        if was_aligned and not knew_heading and trusted:
            turn = about_down(wrapped(course - heading_of(self.dcm_body_to_ned)))
            self.dcm_body_to_ned = turn @ self.dcm_body_to_ned
            self.heading_known = True

        at_rest = speed < 0.15 and float(np.hypot(before[0], before[1])) < 0.15
        level = closed and was_aligned and (knew_heading or at_rest)
        steer = closed and was_aligned and knew_heading and trusted
        w_p = np.zeros(3)
        if level:
            k = np.array([0.0, 0.0, -1.0 / (self.gravity * self.tau)]) * min(1.0, self.tau / length)
            w_p = -np.cross(k, force - self.delta_velocity / length) * np.array([1.0, 1.0, 0.0])
        w_level = w_p.copy()
        if steer:
            innovation = wrapped(course - heading_of(self.dcm_body_to_ned))
            self.reverse = abs(innovation) > (1.40 if self.reverse else 1.75)
            if self.reverse:
                innovation = wrapped(innovation - np.pi)
            w_p[2] = -innovation / self.tau_heading * min(1.0, self.tau_heading / length)
        mean = (self.dcm_at_epoch + self.dcm_body_to_ned) / 2.0
        interval = Interval(
            length=length,
            u=mean.T @ w_p,
            u_level=mean.T @ w_level,
            down=mean[2],
            yaw_rate=self.turn / max(length, 1e-6),
            learn=float(np.interp(abs(self.turn), [0.5, 1.0], [1.0, 0.0])) if level else 0.0,
            steered=steer,
        )
        self.control_rate_ned, self.hold = w_p, length
        self.velocity = v
        self.new_interval()
        return interval


@dataclass(frozen=True, kw_only=True)
class Interval:
    """One closed GNSS interval: the papers' ``u = w_p^b`` in the mean attitude, and the mean yaw rate."""

    length: float
    u: FloatArray
    u_level: FloatArray
    down: FloatArray
    yaw_rate: float
    learn: float
    steered: bool


@dataclass(kw_only=True)
class ReferenceObserver:
    """Tereshkov (2015), Eqs. (11) and (12), with the general gain written as the paper's product."""

    platform: Platform
    tau_gyro: float
    omega_accel: float
    paper_gain: bool
    gyro_bias: FloatArray
    accel_bias: FloatArray

    def step(self, dt: float, gyro: FloatArray, accel: FloatArray) -> None:
        """Feed the bias-free readings to the platform."""
        self.platform.step(dt, gyro - self.gyro_bias, accel - self.accel_bias, paper_rate=self.paper_gain)

    def learn(self, i: Interval) -> None:
        """Integrate both biases over one interval."""
        g, time = self.platform.gravity, i.length * i.learn
        rate = float(np.clip(i.yaw_rate, -2.0, 2.0))
        self.gyro_bias = self.gyro_bias + (i.u_level * time + (i.u - i.u_level) * i.length) / self.tau_gyro
        if self.paper_gain:
            drive = rate * i.u_level * np.array([1.0, 1.0, 0.0])
        else:
            # ([w_b x][k_b x])^T u with w_b along the vertical and k_b = -k down, over k: both unit vectors here.
            down = i.down / np.linalg.norm(i.down)
            drive = (skew(rate * down) @ skew(-down)).T @ i.u_level
        self.accel_bias = self.accel_bias + g * drive * time / self.omega_accel


@dataclass(kw_only=True)
class ReferenceTwoStage:
    """Tereshkov (2013), Eqs. (12) and (14), with the matrix of Eq. (14) in the level frame."""

    platform: Platform
    tau_gyro_lowpass: float
    tau_accel_lowpass: float
    straight_rate: float
    turn_rate: float
    feedback: bool
    gyro_bias: FloatArray
    accel_bias: FloatArray

    def step(self, dt: float, gyro: FloatArray, accel: FloatArray) -> None:
        """Feed the readings to the platform, bias-free with feedback, raw without."""
        share = 1.0 if self.feedback else 0.0
        self.platform.step(dt, gyro - share * self.gyro_bias, accel - share * self.accel_bias, paper_rate=False)

    def learn(self, i: Interval) -> None:
        """Read the gyro bias on straights and the accelerometer bias in turns."""
        g, tau = self.platform.gravity, self.platform.tau
        residual = i.u if self.feedback else i.u - self.gyro_bias
        if not i.steered:
            residual = residual - i.down * (i.down @ residual)
        if abs(i.yaw_rate) > self.turn_rate:
            flat = residual - i.down * (i.down @ residual)
            read = g * (flat / i.yaw_rate + tau * np.cross(i.down, i.u_level))
            error = read if self.feedback else read - self.accel_bias
            self.accel_bias = self.accel_bias + i.learn * error * min(1.0, i.length / self.tau_accel_lowpass)
        if abs(i.yaw_rate) < self.straight_rate:
            self.gyro_bias = self.gyro_bias + i.learn * residual * min(1.0, i.length / self.tau_gyro_lowpass)


Reference = ReferenceObserver | ReferenceTwoStage


@dataclass(frozen=True, kw_only=True)
class ReferenceTrace:
    """Estimates at every IMU sample: biases (n, 3) and roll, pitch, heading (n, 3), NaN before start-up."""

    gyro_bias: FloatArray
    accel_bias: FloatArray
    attitude: FloatArray


def run_reference(
    estimator: Reference,
    time: FloatArray,
    gyro: FloatArray,
    accel: FloatArray,
    gnss_time: FloatArray,
    velocity_ned: FloatArray,
    velocity_std: FloatArray,
) -> ReferenceTrace:
    """Run over a whole log: trapezoids between samples, split at the epochs; IMU gaps as in the kernel.

    Of several epochs between two samples the last one counts, as in the kernel.
    """
    p = estimator.platform
    p.start(accel[0] - estimator.accel_bias)
    n = time.size
    out = ReferenceTrace(gyro_bias=np.empty((n, 3)), accel_bias=np.empty((n, 3)), attitude=np.full((n, 3), np.nan))
    epoch_time: float | None = None
    broken = False

    def close(j: int) -> None:
        nonlocal epoch_time, broken
        length = gnss_time[j] - epoch_time if epoch_time is not None else 0.0
        usable = epoch_time is not None and not broken and length <= min(10.0, 2.0 * p.tau)
        started = p.velocity is not None
        interval = p.close(length, usable, velocity_ned[j], velocity_std[j])
        broken = False
        if interval is None:
            return
        epoch_time = gnss_time[j]
        if started:
            estimator.learn(interval)

    def record(i: int) -> None:
        out.gyro_bias[i], out.accel_bias[i] = estimator.gyro_bias, estimator.accel_bias
        if p.aligned:
            out.attitude[i] = euler_of(p.dcm_body_to_ned)
            if not p.heading_known:
                out.attitude[i, 2] = np.nan

    for j in np.flatnonzero(gnss_time == time[0]):
        close(int(j))
    record(0)
    for i in range(1, n):
        w, f = (gyro[i - 1] + gyro[i]) / 2.0, (accel[i - 1] + accel[i]) / 2.0
        now, gap = time[i - 1], time[i] - time[i - 1] > 0.2
        broken = broken or bool(gap)
        inside = np.flatnonzero((gnss_time > now) & (gnss_time < time[i]))
        if inside.size:
            last = int(inside[-1])
            estimator.step(gnss_time[last] - now, w, f)
            now = gnss_time[last]
            close(last)
            broken = bool(gap) and now < time[i]
        estimator.step(time[i] - now, w, f)
        for at_sample in np.flatnonzero(gnss_time == time[i]):
            close(int(at_sample))
        record(i)
    return out

"""NumPy twin of the phasor filter: dense complex matrices and the equations of docs/theory/phasor.md, slow and obvious.

The four errors are a vector (nu, theta, beta_g, beta_a) with a 4 by 4 Hermitian covariance; heading and vertical gyro
bias, vertical velocity and vertical accelerometer bias are two real pairs; `share` (4, 2) is the first pair's part in
the four. Where the header has closed forms this file has a matrix exponential, where it has scalars, matrix inverses.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from levelhead.conventions import FloatArray
from levelhead.kernel.reference import (
    DOWN,
    about_down,
    euler_of,
    heading_of,
    nearest_rotation,
    rotation,
    smallest_rotation,
    wrapped,
)
from levelhead.kernel.reference_smoother import (
    ComplexArray,
    Measured,
    Record,
    as_complex,
    as_vector,
    embedded,
    exponential,
    stacked,
)

NU, THETA, GYRO, ACCEL = range(4)
EARTH_RATE, EARTH_RADIUS = 7.292115e-5, 6.371e6
UNKNOWN_HEADING_VAR = 1e6
LONGEST_STEP, LARGEST_TURN = 0.999, 0.35
BRIDGE_GAP, RESET_GAP = 0.2, 2.0


@dataclass(kw_only=True)
class ReferencePhasor:
    """The phasor filter; constants as `PhasorParams.kernel_arguments` gives them (variances per second)."""

    min_course_speed: float
    gravity: float
    lever_arm: FloatArray
    gyro_noise: float
    accel_noise: float
    gyro_bias_walk: float
    accel_bias_walk: float
    velocity_std: float
    sideslip_std: float
    axle_std: float
    initial_gyro_bias_std: float
    initial_accel_bias_std: float
    latitude: float | None
    gravity_std: float
    gyro_bias: FloatArray = field(default_factory=lambda: np.zeros(3))
    accel_bias: FloatArray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        gyro, accel = self.initial_gyro_bias_std**2, self.initial_accel_bias_std**2
        self.p: ComplexArray = np.diag([0.0, 0.0, gyro, accel]).astype(np.complex128)
        self.turning = np.diag([UNKNOWN_HEADING_VAR, gyro])
        self.lifting = np.diag([0.0, accel])
        self.share: ComplexArray = np.zeros((4, 2), dtype=np.complex128)
        self.azimuth = 1.0 + 0.0j
        self.yaw_rate = self.time = 0.0
        self.records: list[Record] = []
        self.joint_move, self.lift_move = np.eye(10), np.eye(2)

    # ---- the platform ----

    def restart(self, force: FloatArray, lost: float) -> None:
        """Level from one reading, upright or rolled over; the biases have aged by `lost` seconds."""
        c = np.diag([1.0, -1.0, -1.0]) if force[2] > 0.0 else np.eye(3)
        self.dcm = smallest_rotation(c @ force, -DOWN) @ c
        self.frame_rate = np.zeros(3)
        self.velocity = np.zeros(3)
        self.have_velocity = self.aligned = self.heading_known = self.reverse = False
        self.begin_interval()
        self.rate = np.zeros(3)
        gyro, accel = self.gyro_bias_walk * lost, self.accel_bias_walk * lost
        shared = np.einsum("ij,jk,ik->i", self.share, self.turning, self.share.conj()).real / 2.0
        self.p = self.p + np.diag([0.0, 0.0, gyro + shared[GYRO], accel + shared[ACCEL]])
        self.share = np.zeros((4, 2), dtype=np.complex128)
        self.turning = self.turning + np.diag([0.0, gyro])
        self.lifting = self.lifting + np.diag([0.0, accel])

    def begin_interval(self) -> None:
        """Begin the integrals anew."""
        self.delta_velocity, self.turn, self.elapsed, self.gap_tilt, self.gap_velocity = np.zeros(3), 0.0, 0.0, 0.0, 0.0

    def step(self, dt: float, gyro: FloatArray, accel: FloatArray) -> None:
        """Integrate attitude and velocity over one step with steady readings, the frame turning underneath."""
        w, f, c = gyro - self.gyro_bias, accel - self.accel_bias, self.dcm
        after = rotation(-self.frame_rate * dt) @ c @ rotation(w * dt)
        middle = rotation(-self.frame_rate * dt / 2) @ c @ rotation(w * dt / 2)
        self.delta_velocity = self.delta_velocity + (c + 4.0 * middle + after) @ f * dt / 6.0
        self.turn += float(c[2] @ w) * dt
        self.elapsed += dt
        self.rate = w
        self.dcm = nearest_rotation(after)
        if self.aligned and (self.elapsed >= LONGEST_STEP or abs(self.turn) > LARGEST_TURN):
            self.move()
            self.record()

    def bridge(self, gap: float, gyro_change: FloatArray, accel_change: FloatArray) -> None:
        """Count with what an IMU gap hides."""
        self.gap_tilt += ((float(np.linalg.norm(gyro_change)) / 2 + 0.01) * gap) ** 2
        self.gap_velocity += ((float(np.linalg.norm(accel_change)) / 2 + 0.2) * gap) ** 2

    def feel_the_earth(self, time: float) -> None:
        """Coriolis acceleration over `time`, and the rate at which the NED frame turns from here on."""
        turn, coriolis = self.frame(self.velocity)
        if self.heading_known:
            self.velocity = self.velocity - np.cross(coriolis, self.velocity) * time
        self.frame_rate = turn if self.heading_known else turn * DOWN

    def frame(self, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return how the NED frame turns, and the rate whose cross product with the velocity is felt as Coriolis."""
        if self.latitude is None:
            return np.zeros(3), np.zeros(3)
        sin, cos = np.sin(self.latitude), np.cos(self.latitude)
        earth = EARTH_RATE * np.array([cos, 0.0, -sin])
        north, east = velocity[:2] / EARTH_RADIUS
        transport = np.array([east, -north, -east * sin / max(cos, 0.01)])
        return earth + transport, 2.0 * earth + transport

    # ---- time ----

    def move(self) -> None:
        """Bring velocity and covariances up to now."""
        t, g = self.elapsed, self.gravity
        force = np.clip(-self.delta_velocity[2] / t, 0.5 * g, 2.0 * g) if t > 0.0 else g
        w = self.turn / t if t > 0.0 else 0.0
        dv = self.delta_velocity
        self.velocity = self.velocity + dv + g * DOWN * t
        self.feel_the_earth(t)
        self.azimuth *= np.exp(1j * self.turn)
        rates = np.array([[-1j * w, 1j * force, 0, 1], [0, -1j * w, 1, 0], [0, 0, 0, 0], [0, 0, 0, 0]])
        f = exponential(rates.astype(np.complex128) * t)
        push = 1j * as_complex(dv) / self.azimuth if self.heading_known else 0.0

        self.p = f @ self.p @ f.conj().T
        turned = np.array([[1.0, t], [0.0, 1.0]])
        pushed = np.zeros((4, 2), dtype=np.complex128)
        pushed[NU] = push, push * t / 2
        # The errors are f x + pushed (psi, b) as the pair was; the share is wanted of the pair as it is.
        self.share = (f @ self.share + pushed) @ np.linalg.inv(turned)
        self.turning = turned @ self.turning @ turned.T
        self.hear(np.diag([self.gyro_noise * t + self.gap_tilt, 0.0]))
        walk = self.gyro_bias_walk
        self.turning = self.turning + walk * np.array([[t**3 / 3, t**2 / 2], [t**2 / 2, 0.0]])
        self.hear(np.diag([0.0, walk * t]))

        self.p = self.p + self.noise(t, float(force))
        self.lifting = turned @ self.lifting @ turned.T
        accel, accel_walk = self.accel_noise, self.accel_bias_walk
        self.lifting = self.lifting + np.array(
            [
                [accel * t + accel_walk * t**3 / 3 + self.gap_velocity, accel_walk * t**2 / 2],
                [accel_walk * t**2 / 2, accel_walk * t],
            ]
        )
        if t > 0.0:
            self.yaw_rate = w
        joint = np.zeros((10, 10))
        joint[:8, :8], joint[:8, 8:], joint[8:, 8:] = embedded(f), stacked(pushed), turned
        self.joint_move, self.lift_move = joint, turned
        self.begin_interval()

    def hear(self, news: FloatArray) -> None:
        """Add noise to the first pair; what the pair then does not tell of its old self goes into the covariance."""
        if not news.any():
            return
        before, after = self.turning, self.turning + news
        told = before @ np.linalg.inv(after)  # the old pair's regression on the new one
        rest = before - told @ before
        self.p = self.p + self.share @ (rest / 2.0) @ self.share.conj().T
        self.share = self.share @ told
        self.turning = after

    def noise(self, t: float, force: float) -> ComplexArray:
        """Return what white noise and random walks add over a time, their leading terms."""
        q = np.zeros((4, 4), dtype=np.complex128)
        q[NU, NU] = self.accel_noise * t + force**2 * self.gyro_noise * t**3 / 3 + self.accel_bias_walk * t**3 / 3
        q[NU, THETA] = 1j * force * self.gyro_noise * t**2 / 2
        q[NU, ACCEL] = self.accel_bias_walk * t**2 / 2
        q[THETA, THETA] = self.gyro_noise * t + self.gyro_bias_walk * t**3 / 3
        q[THETA, GYRO] = self.gyro_bias_walk * t**2 / 2
        q[GYRO, GYRO] = self.gyro_bias_walk * t
        q[ACCEL, ACCEL] = self.accel_bias_walk * t
        upper = np.triu(q, 1)
        gaps: ComplexArray = np.diag([self.gap_velocity, self.gap_tilt, 0.0, 0.0]).astype(np.complex128)
        return q + upper.conj().T + gaps

    # ---- a fix ----

    def epoch(self, length: float, usable: bool, antenna: FloatArray, std: FloatArray) -> bool:
        """Take a fix. Returns False while start-up goes on waiting."""
        if self.aligned:
            self.move()
        v = antenna - self.dcm @ np.cross(self.rate, self.lever_arm)
        speed, course = float(np.hypot(v[0], v[1])), float(np.arctan2(v[1], v[0]))
        horizontal = float(np.sqrt((std[0] ** 2 + std[1] ** 2) / 2))
        r, r_down = self.variance(horizontal), self.variance(float(std[2]))
        trusted = speed > self.min_course_speed and not horizontal > 0.26 * speed
        at_rest = speed < 0.15 and float(np.hypot(self.velocity[0], self.velocity[1])) < 0.15

        if not self.aligned and not (self.have_velocity and usable):
            self.velocity, self.have_velocity, self.delta_velocity, self.turn = v, True, np.zeros(3), 0.0
        elif not self.aligned:
            if length < 0.999:
                return False
            self.align(length, v, trusted, course, r, r_down)
        else:
            knew_heading = self.heading_known
            if trusted and not knew_heading:
                self.take_course(speed, course, r)
            if knew_heading or at_rest:
                self.correct(v, course, r, r_down, self.course_variance(length, speed, r) if trusted else None)
            else:
                self.take_velocity(v, r, r_down)
        return True

    def variance(self, std: float) -> float:
        """Return the variance of a fix."""
        return float(self.velocity_std if np.isnan(std) else np.clip(std, 1e-4, 1e3)) ** 2

    def slide(self, speed: float) -> float:
        """Return how far course and heading can differ, rad^2."""
        return self.sideslip_std**2 + (self.axle_std * self.yaw_rate / speed) ** 2

    def course_variance(self, length: float, speed: float, r: float) -> float:
        """Return the variance of one look at a course out of many: a sideslip stays for two seconds."""
        return r / speed**2 + self.slide(speed) * max(1.0, 4.0 / length)

    def align(self, length: float, v: FloatArray, trusted: bool, course: float, r: float, r_down: float) -> None:
        """Level the platform so that the mean specific force is what GNSS says; know what is then in the tilt."""
        g = self.gravity
        force = (v - self.velocity) / length - g * DOWN
        c = self.dcm
        measured = c.T @ self.delta_velocity / length
        for _ in range(6):
            c = about_down(wrapped(course - heading_of(c)) if trusted else 0.0) @ c
            c = smallest_rotation(c @ measured, force) @ c
        self.dcm, self.aligned, self.heading_known, self.velocity = c, True, trusted, v
        self.azimuth = 1.0 + 0.0j
        self.yaw_rate = self.turn / length
        self.feel_the_earth(0.0)
        # i g mean(theta) + mean(beta_a) = dn/T, with biases that turned by `turn` until now.
        u = (np.arange(2000) + 0.5) / 2000
        back = np.exp(1j * self.turn * (u - 1.0))
        tilts = np.array([0.0, 0.0, length * np.mean(u * back), 1j / g * np.mean(back)])
        bias = self.p[GYRO:, GYRO:]
        spread = np.vstack([np.zeros(2), tilts[GYRO:], np.eye(2)])
        self.p = spread @ bias @ spread.conj().T
        lean = -as_complex(force) / g
        own = (2.0 * r / length**2 + self.accel_noise / length) / g**2 + self.gyro_noise * length / 2
        self.p[THETA, THETA] += own + (0.0 if trusted else abs(lean) ** 2)
        self.p[NU, NU] = r
        self.p[NU, THETA] = 1j * r / length / g
        self.p[THETA, NU] = -1j * r / length / g
        self.share = np.zeros((4, 2), dtype=np.complex128)
        speed = float(np.hypot(v[0], v[1]))
        heading = UNKNOWN_HEADING_VAR
        if trusted:
            self.share[THETA, 0] = lean
            heading = r / speed**2 + self.slide(speed)
        self.turning = np.diag([heading, self.turning[1, 1]])
        self.lifting = np.diag([r_down, self.lifting[1, 1]])
        self.begin_interval()
        self.record(fresh=True)

    def take_course(self, speed: float, course: float, r: float) -> None:
        """Turn the platform to the first course, the level frame with it."""
        angle = wrapped(course - heading_of(self.dcm))
        self.dcm = about_down(angle) @ self.dcm
        self.azimuth *= np.exp(1j * angle)
        self.heading_known = True
        s = self.turning[0, 0] + r / speed**2 + self.slide(speed)
        self.turning = self.turning - np.outer(self.turning[:, 0], self.turning[0]) / s
        self.share = np.zeros((4, 2), dtype=np.complex128)
        # What a stand has put into the gyro bias of the Earth's rate, now that North is known, can be told apart.
        unseen, _ = self.frame(self.velocity)
        learnt = float(np.clip(1.0 - self.p[GYRO, GYRO].real / self.initial_gyro_bias_std**2, 0.0, 1.0))
        if (self.azimuth * np.exp(-1j * angle)).real > 0.98:
            self.gyro_bias = self.gyro_bias - self.dcm.T @ (unseen * learnt * (1.0 - DOWN))
            self.p[GYRO, GYRO] += self.unseen_var() * (0.2 * learnt) ** 2
        else:
            self.p[GYRO, GYRO] += self.unseen_var()

    def unseen_var(self) -> float:
        """Return the variance of the Earth's horizontal rate, of unknown direction, per axis."""
        unseen, _ = self.frame(self.velocity)
        return float(unseen[0] ** 2 + unseen[1] ** 2) / 2.0

    def take_velocity(self, v: FloatArray, r: float, r_down: float) -> None:
        """Begin at this velocity and learn nothing from the one before."""
        self.p[NU, :] = self.p[:, NU] = self.share[NU, :] = 0.0
        self.p[NU, NU] = r
        self.lifting = np.diag([r_down, self.lifting[1, 1]])
        self.velocity = v

    def correct(self, v: FloatArray, course: float, r: float, r_down: float, r_course: float | None) -> None:
        """Fold in velocity and course (`r_course` None: the course says nothing)."""
        error = self.velocity - v
        z, y_down, y = as_complex(error) / self.azimuth, float(error[2]), 0.0
        if r_course is not None:
            raw = wrapped(course - heading_of(self.dcm))
            self.reverse = abs(raw) > (1.40 if self.reverse else 1.75)
            y = -wrapped(raw - np.pi) if self.reverse else -raw
        predicted, lift_predicted = self.joint(), self.lifting
        seen_pair = stacked(self.share[NU : NU + 1])  # (2, 2): of the pair in the velocity's two components
        own = self.p[NU, NU].real
        shared = np.trace(seen_pair @ self.turning @ seen_pair.T) / 2.0
        s_course, s_down = self.turning[0, 0] + (1.0 if r_course is None else r_course), self.lifting[0, 0] + r_down
        surprise = abs(z) ** 2 / (own + r + shared) / 16.0, y_down**2 / s_down / 14.0, y**2 / s_course / 14.0
        doubt = max(1.0, *surprise)

        s = (own + r) * doubt
        gain = self.p[:, NU] / s
        self.p = self.p - np.outer(gain, self.p[NU, :])
        pair_gain = self.turning @ seen_pair.T @ np.linalg.inv(s * np.eye(2) + seen_pair @ self.turning @ seen_pair.T)
        pair = pair_gain @ np.array([z.real, z.imag])
        self.turning = self.turning - pair_gain @ seen_pair @ self.turning
        self.share = self.share - np.outer(gain, self.share[NU, :])
        rows, seen, noise = np.eye(10)[[0, 4]], [z.real, z.imag], [s - own] * 2
        if r_course is not None:
            doubted = r_course * doubt + (doubt - 1.0) * self.turning[0, 0]
            k = self.turning[:, 0] / (self.turning[0, 0] + doubted)
            pair = pair + k * (y - pair[0])
            self.turning = self.turning - np.outer(k, self.turning[0])
            rows, seen, noise = np.eye(10)[[0, 4, 8]], [*seen, y], [*noise, doubted]
        lift = self.lifting[:, 0] / (s_down * doubt)
        self.lifting = self.lifting - np.outer(lift, self.lifting[0])

        x = gain * z + self.share @ pair
        self.velocity = self.velocity - as_vector(self.azimuth * x[NU], lift[0] * y_down)
        self.gyro_bias = self.gyro_bias + self.dcm.T @ as_vector(self.azimuth * x[GYRO], pair[1])
        self.accel_bias = self.accel_bias + self.dcm.T @ as_vector(self.azimuth * x[ACCEL], lift[1] * y_down)
        self.dcm = rotation(-as_vector(self.azimuth * x[THETA], pair[0])) @ self.dcm
        self.azimuth *= np.exp(-1j * pair[0])
        self.record(
            Measured(
                predicted=predicted,
                rows=rows,
                seen=np.array(seen),
                noise=np.array(noise),
                correction=np.concatenate([x.real, x.imag, pair]),
                lift_predicted=lift_predicted,
                lift_correction=lift * y_down,
            )
        )

    # ---- what is seen from outside ----

    def joint(self) -> FloatArray:
        """Return the covariance of the ten real errors of a `Record`."""
        share = stacked(self.share)
        joint = np.empty((10, 10))
        joint[:8, :8] = embedded(self.p) + share @ self.turning @ share.T
        joint[:8, 8:] = share @ self.turning
        joint[8:, :8] = joint[:8, 8:].T
        joint[8:, 8:] = self.turning
        return joint

    def record(self, measured: Measured | None = None, *, fresh: bool = False) -> None:
        """Keep what a smoother needs."""
        self.records.append(
            Record(
                time=self.time,
                moved=self.joint_move,
                covariance=self.joint(),
                lift_moved=self.lift_move,
                lift_covariance=self.lifting,
                measured=Measured.nothing(self.joint(), self.lifting) if measured is None else measured,
                fresh=fresh,
                dcm_body_to_ned=self.dcm,
                azimuth=self.azimuth,
                velocity=self.velocity,
                gyro_bias=self.gyro_bias,
                accel_bias=self.accel_bias,
            )
        )

    def sigma(self) -> FloatArray:
        """Return one sigma of gyro bias, accelerometer bias (body axes) and roll, pitch, heading: (9,)."""
        level = (
            self.p.diagonal().real + np.einsum("ij,jk,ik->i", self.share, self.turning, self.share.conj()).real / 2.0
        )
        down = self.dcm[2]
        if not self.heading_known and self.aligned:
            level[GYRO] += self.unseen_var()
        gyro = level[GYRO] + (self.turning[1, 1] - level[GYRO]) * down**2
        accel = level[ACCEL] + (self.lifting[1, 1] + self.gravity_std**2 - level[ACCEL]) * down**2
        tilt, cos2 = level[THETA], 1.0 - down[0] ** 2
        heading = (self.turning[0, 0] if self.heading_known else np.pi**2) + tilt * down[0] ** 2 / cos2
        angles = np.array([tilt / cos2, tilt, heading]) if self.aligned else np.full(3, np.pi**2)
        sigma: FloatArray = np.sqrt(np.concatenate([gyro, accel, angles]))
        return sigma


def reference_phasor(arguments: dict[str, Any]) -> ReferencePhasor:
    """Return the twin with `PhasorParams.kernel_arguments`: velocities alone, no standstill."""
    names = {f.name for f in fields(ReferencePhasor)}
    known = {name: value for name, value in arguments.items() if name in names}
    return ReferencePhasor(**{**known, "lever_arm": np.array(arguments["lever_arm"])})


@dataclass(frozen=True, kw_only=True)
class PhasorTrace:
    """The filter's state at every IMU sample: biases and attitude (n, 3), NaN where unknown; `sigma` (n, 9)."""

    gyro_bias: FloatArray
    accel_bias: FloatArray
    attitude: FloatArray
    velocity_ned: FloatArray
    sigma: FloatArray


def run_reference_phasor(
    estimator: ReferencePhasor,
    time: FloatArray,
    gyro: FloatArray,
    accel: FloatArray,
    gnss_time: FloatArray,
    velocity_ned: FloatArray,
    velocity_std: FloatArray,
) -> PhasorTrace:
    """Run over a whole log: trapezoids between samples, split at the epochs; gaps and restarts as in the kernel.

    Of several epochs between two samples the last one counts, as in the kernel.
    """
    e, n = estimator, time.size
    out = PhasorTrace(
        gyro_bias=np.empty((n, 3)),
        accel_bias=np.empty((n, 3)),
        attitude=np.full((n, 3), np.nan),
        velocity_ned=np.full((n, 3), np.nan),
        sigma=np.empty((n, 9)),
    )
    epoch_time: float | None = None
    broken = False

    def close(j: int) -> None:
        nonlocal epoch_time, broken
        e.time = gnss_time[j]
        length = gnss_time[j] - epoch_time if epoch_time is not None else 0.0
        usable = epoch_time is not None and not broken and length <= 10.0
        broken = False
        if e.epoch(length, usable, velocity_ned[j], velocity_std[j]):
            epoch_time = gnss_time[j]

    def step(start: float, stop: float, w: FloatArray, f: FloatArray) -> None:
        e.time = stop
        if stop > start:
            e.step(stop - start, w, f)

    def show(i: int) -> None:
        out.gyro_bias[i], out.accel_bias[i], out.sigma[i] = e.gyro_bias, e.accel_bias, e.sigma()
        if e.aligned:
            out.attitude[i] = euler_of(e.dcm)
            out.velocity_ned[i] = e.velocity + e.delta_velocity + e.gravity * e.elapsed * DOWN
            if not e.heading_known:
                out.attitude[i, 2] = np.nan

    e.restart(accel[0] - e.accel_bias, 0.0)
    for j in np.flatnonzero(gnss_time == time[0]):
        close(int(j))
    show(0)
    for i in range(1, n):
        now, length = time[i - 1], time[i] - time[i - 1]
        at_sample = np.flatnonzero(gnss_time == time[i])
        if length > RESET_GAP:
            e.restart(accel[i] - e.accel_bias, length)
            epoch_time, broken = None, False
        else:
            gap = bool(length > BRIDGE_GAP)
            if gap:
                broken = True
                e.bridge(length, gyro[i] - gyro[i - 1], accel[i] - accel[i - 1])
            w, f = (gyro[i - 1] + gyro[i]) / 2.0, (accel[i - 1] + accel[i]) / 2.0
            inside = np.flatnonzero((gnss_time > now) & (gnss_time < time[i]))
            if inside.size:
                last = int(inside[-1])
                step(now, gnss_time[last], w, f)
                now = gnss_time[last]
                close(last)
                broken = gap
            step(now, time[i], w, f)
        for j in at_sample:
            close(int(j))
        show(i)
    return out

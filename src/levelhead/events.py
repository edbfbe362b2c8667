"""Events: what happened to the data on its way, counted, with the first and the last time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from levelhead.errors import printable

EVENT_TEXTS: Final[dict[str, str]] = {
    "I_VELOCITY_DERIVED": "The log has positions but no velocities: velocities were derived from the positions.",
    "I_NOISE_FOUND": "The readings are noisier than by default, vibration included, and are trusted less:",
    "W_INNOVATIONS": "The GNSS fixes differ more from what the filter expects than its noise parameters explain,",
    "W_TRUNCATED": "A cut line or record at the start or the end of the file was left out.",
    "W_DAMAGED": "The file is damaged in places; what could not be read there was left out.",
    "I_SIBLING": "The GNSS data was taken from a file beside the log whose name goes with it:",
    "W_DROPPED": "Records that cannot be used were left out:",
    "W_LOGGER_DROPOUT": "The recorder could not keep up and lost data:",
    "W_CALIBRATION_CHANGED": "The autopilot changed its calibration during the log, and the biases with it:",
    "W_RECORD_TIME": "Messages without a stamp of their own were taken at the time of their recording, which is late:",
    "W_TIME_SCALE": "Two files count from 1970, but one does not say whether in UTC or in GPS time, 18 s apart; they "
    "were taken as one clock (a header with time[UTC] or time[GPST] says it, or --latency how far they are apart):",
    "W_COMPENSATED": "The readings had biases taken off before they were recorded.",
    "I_VELOCITY_2D": "The receiver tells no vertical velocity: it was taken as zero, with a wide sigma.",
    "I_DECIMATED": "An INS tells its velocity with every IMU sample; only some of these were taken as GNSS epochs:",
    "I_REORDERED": "Samples were not in the order of their time stamps, and were sorted.",
    "W_DUP_TIME": "Of samples with the same time stamp the first was used, the others dropped.",
    "W_NO_EPOCHS": "GNSS epochs outside the span of the IMU data were not used.",
    "E_UNIT_GYRO": "The gyros' unit:",
    "E_UNIT_ACCEL": "The accelerometers' unit:",
    "E_UNIT_VEL": "The GNSS velocities' unit:",
    "E_NO_GRAVITY": "Gravity is not in the accelerometers' readings:",
    "E_AXES": "The IMU's axes:",
    "E_FSIGN": "The sign of the specific force:",
    "E_VEL_FRAME": "The frame of the GNSS velocity:",
    "W_MOUNT_YAW": "The mounting of the IMU:",
    "W_LATENCY": "The clocks:",
    "W_NO_LEVER": "The GNSS antenna is not at the IMU:",
    "W_CLIP": "The range of a sensor:",
    "E_STUCK": "A stuck sensor:",
    "W_GAP": "The IMU data has gaps: no bias was learnt across them.",
    "E_GAP_RESET": "An IMU gap was too long to bridge: the attitude was levelled anew, the biases were kept.",
    "S_COAST": "GNSS was absent: the attitude followed the gyros alone, the biases were held.",
    "S_REVERSE": "The vehicle drove backwards: the course was turned round.",
    "W_MOSTLY_REVERSE": "The vehicle seems to drive backwards most of the time: the log begins in reverse, or the "
    "IMU faces backwards. The heading may be the opposite and nothing is called known; begin with a forward drive.",
    "W_TIME_BACK": "Samples with time stamps at or before the previous one were dropped.",
    "E_NONFINITE": "Samples with NaN or infinity were dropped.",
    "S_STATIONARY": "The vehicle stood still: velocity and rotation were taken as zero.",
    "W_POSITION_JUMP": "GNSS positions were far from the filter's for ten seconds: its position began anew from them.",
    "W_UNSTEADY": "In the last two minutes these estimates still moved; take that as their uncertainty:",
    "W_TAU_RATIO": "tau_gyro is below four times tau (or tau_heading): the estimates will ring.",
}
"""Every event code and the sentence that explains it to a user."""


@dataclass(frozen=True, kw_only=True)
class Event:
    """One kind of event: ``code`` is a key of `EVENT_TEXTS`, times are seconds from the log's start."""

    code: str
    count: int
    first_s: float | None = None
    last_s: float | None = None
    detail: str = ""

    def __post_init__(self) -> None:
        # Details quote names that stand in a file.
        object.__setattr__(self, "detail", printable(self.detail))

    @property
    def text(self) -> str:
        """The sentence for the user, with the detail of this occurrence."""
        return f"{EVENT_TEXTS[self.code]} {self.detail}".strip()

    def as_dict(self) -> dict[str, object]:
        """Return the event as `summary.json` shows it."""
        return {
            "code": self.code,
            "count": self.count,
            "first_s": self.first_s,
            "last_s": self.last_s,
            "text": self.text,
        }


def merge_events(events: Iterable[Event]) -> tuple[Event, ...]:
    """Add up events of the same code, in order of first appearance."""
    merged: dict[str, Event] = {}
    for event in events:
        before = merged.get(event.code)
        if before is None:
            merged[event.code] = event
            continue
        firsts = [t for t in (before.first_s, event.first_s) if t is not None]
        lasts = [t for t in (before.last_s, event.last_s) if t is not None]
        merged[event.code] = Event(
            code=event.code,
            count=before.count + event.count,
            first_s=min(firsts, default=None),
            last_s=max(lasts, default=None),
            detail=" ".join(d for d in (before.detail, event.detail) if d),
        )
    return tuple(merged.values())

"""Links by name: ``preset = "wifi"`` in a table of link settings.

One direction each, so delays are half a round trip. Where a source gives a
figure it is named; the rest are round numbers of ours, of the size one meets,
to be replaced by your own measurements (``distribution = "empirical"``).

ideal
    Nothing happens to a message.
lan
    Switched Gigabit Ethernet: 1 Gbit/s with 38 bytes around each frame
    (preamble, header, check sequence, gap: IEEE 802.3); delay ours.
wifi
    One access point, few stations: some milliseconds, rare short bursts of loss
    after the retries of IEEE 802.11 are used up; all figures ours.
wifi-congested
    The same with many stations: queueing in tens of milliseconds with a heavy
    tail, longer bursts, 5 Mbit/s and a queue that overflows; all figures ours.
lte
    A public LTE cell: 3GPP TR 25.913 asks for at most 5 ms one way in an unloaded
    network; load, retransmission and the way through the core add the rest (ours).
    Order is kept, as LTE's link layer (RLC) does.
satellite
    A geostationary satellite: 2 · 35,786 km at the speed of light are 0.2387 s,
    and no less; 10 Mbit/s, jitter and loss ours.
robot-link
    The link of Open Robotics' Zenoh evaluation (github.com/osrf/zenoh_evaluation):
    60 Mbit/s, 2 ms, 0.14 % loss.
"""

from typing import Any, Final

PRESETS: Final[dict[str, dict[str, Any]]] = {
    "ideal": {},
    "lan": {
        "delay": {"distribution": "gamma", "offset_s": 5e-5, "mean_s": 5e-5, "stddev_s": 2e-5},
        "rate": {"bits_per_s": 1_000_000_000, "overhead_bytes": 38},
    },
    "wifi": {
        "delay": {
            "distribution": "lognormal",
            "offset_s": 0.001,
            "mean_s": 0.002,
            "stddev_s": 0.002,
            "correlation": 0.25,
        },
        "loss": {"model": "gilbert_elliott", "p": 0.002, "r": 0.5},
        "keep_order": True,
    },
    "wifi-congested": {
        "delay": {
            "distribution": "lognormal",
            "offset_s": 0.002,
            "mean_s": 0.03,
            "stddev_s": 0.03,
            "correlation": 0.5,
        },
        "loss": {"model": "gilbert_elliott", "p": 0.02, "r": 0.25, "loss_in_bad": 0.8},
        "rate": {"bits_per_s": 5_000_000},
        "queue": {"messages": 200},
        "keep_order": True,
    },
    "lte": {
        "delay": {"distribution": "gamma", "offset_s": 0.005, "mean_s": 0.02, "stddev_s": 0.01},
        "loss": {"model": "random", "probability": 0.001},
        "keep_order": True,
    },
    "satellite": {
        "delay": {"distribution": "gamma", "offset_s": 0.2387, "mean_s": 0.02, "stddev_s": 0.005},
        "loss": {"model": "random", "probability": 0.001},
        "rate": {"bits_per_s": 10_000_000},
        "keep_order": True,
    },
    "robot-link": {
        "delay": {"distribution": "constant", "mean_s": 0.002},
        "loss": {"model": "random", "probability": 0.0014},
        "rate": {"bits_per_s": 60_000_000},
    },
}

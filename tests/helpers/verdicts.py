"""A verdict made by hand, for what is told of one."""

from formnet.exact import ARITHMETIC_VERSION
from formnet.formation.scenario.expect import CRITERIA
from formnet.lab.verdict.model import FORMAT, Verdict

RICH = {
    "outcome": {"kind": "diverged", "t_s": 3.0, "robot": 2, "reason": "it is too fast"},
    "warnings": ["law.beta: too large"],
    "theorem": 6,
    "formation_error_m": 0.5,
    "heading_error_rad": 0.25,
    "centroid_error_m": 1e300,
    "settling_time_s": 1.5,
    "motion": {
        "closest": {"distance_m": 0.1, "robots": [1, 2], "t_s": 0.5},
        "top_speed": {"speed_mps": 2.0, "robot": 1, "t_s": 0.5},
        "top_turn_rate": {"turn_rate_radps": 2.0, "robot": 1, "t_s": 0.5},
        "top_command": {"torque_nm": 2.0, "robot": 1, "t_s": 0.5},
    },
    "lyapunov": {
        "equation": 43,
        "from_s": 0.1,
        "initial": 10.0,
        "final": 1.0,
        "budget": 2.0,
        "may_rise_by": ["variable delay"],
        "rises": [
            {
                "begin_s": 1.0,
                "end_s": 1.25,
                "gain": 0.5,
                "relative_gain": 0.25,
                "causes": ["robot 3 lost at 1 s"],
            },
            {"begin_s": 2.0, "end_s": 3.0, "gain": None, "relative_gain": None, "causes": []},
        ],
    },
    "messages": {
        "sent": 10,
        "fates": {"delivered": 8, "lost: random": 2},
        "rejected": [{"robot": "plant", "source": 1, "reason": "malformed", "times": 2}],
        "refused": [{"who": "robot-1", "key": "formnet/x/broadcast/2", "times": 4}],
    },
    "links": [
        {
            "source": 1,
            "destination": 2,
            "sent": 10,
            "delivered": 8,
            "duplicated": 0,
            "corrupted": 0,
            "in_flight": 0,
            "lost": {"random": 2},
            "delay_s": {
                "min": 0.1,
                "mean": 0.15,
                "p50": 0.15,
                "p95": 0.2,
                "p99": 0.2,
                "max": 0.2,
            },
            "jitter_s": 0.01,
            "longest_silence_s": 0.3,
        }
    ],
    "realtime": {
        "plant": {"woke_late_s": {"p50": 1e-4, "p99": 1e-3, "max": 2e-3}},
        "robots": {
            "1": {
                "periods": 3000,
                "missed": 1,
                "sense_to_drive_s": {"p50": 1e-4, "p99": 1e-3, "max": 2e-3},
                "woke_late_s": None,
                "transit_s": {"p50": 1e-4, "p99": 1e-3, "max": 2e-3},
                "clock_offset_s": -1e-5,
                "clock_uncertainty_s": 1e-4,
            }
        },
    },
}
"""Something in every section."""


def judgement(*, expected=None, observed=None, holds=None, tolerance=0.1, largest=None):
    """An entry of ``claims``."""
    return {
        "expected": expected,
        "observed": observed,
        "holds": holds,
        "tolerance": tolerance,
        "largest_in_window": largest,
    }


def made(*, kind="completed", t_s=3.0, judged=(1, 2, 3), lost=(), claims=None, **changes):
    """A verdict; ``claims`` has keyword arguments of :func:`judgement` by name."""
    given = claims or {}
    return Verdict.model_validate(
        {
            "format": FORMAT,
            "scenario": "made",
            "mode": "inline",
            "seed": 1,
            "outcome": {"kind": kind, "t_s": t_s, "robot": None, "reason": ""},
            "robots": {
                "judged": list(judged),
                "down_at_the_end": [],
                "lost": [{"t_s": 1.0, "robot": r, "reason": "died", "tick": 1000} for r in lost],
            },
            "warnings": [],
            "theorem": None,
            "why": "no theorem applies",
            "formation_error_m": None,
            "heading_error_rad": None,
            "centroid_error_m": None,
            "window_s": 0.3,
            "settling_time_s": None,
            "claims": {name: judgement(**given.get(name, {})) for name in CRITERIA},
            "motion": None,
            "lyapunov": None,
            "trajectory_sha256": "0" * 64,
            "arithmetic": ARITHMETIC_VERSION,
            "messages": {"sent": 0, "fates": {}, "rejected": [], "refused": []},
            "links": [],
            "simulated_s": t_s,
            "wall_s": 1.0,
            "realtime_factor": t_s,
            "realtime": None,
            "versions": {"formnet": "0.1.0"},
            **changes,
        }
    )

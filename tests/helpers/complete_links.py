"""Tables of a link's settings that together have every parameter of every kind."""

from typing import Any

COMPLETE: dict[str, list[dict[str, Any]]] = {
    "delay": [
        {"distribution": "constant", "mean_s": 0.1},
        {"distribution": "uniform", "low_s": 0.1, "high_s": 0.2, "correlation": 0.5},
        *(
            {
                "distribution": name,
                "mean_s": 0.1,
                "stddev_s": 0.1,
                "offset_s": 0.1,
                "correlation": 0.5,
            }
            for name in ("normal", "lognormal", "gamma")
        ),
        {
            "distribution": "weibull",
            "scale_s": 0.1,
            "shape": 2.0,
            "offset_s": 0.1,
            "correlation": 0.5,
        },
        {
            "distribution": "pareto",
            "minimum_s": 0.1,
            "shape": 3.0,
            "offset_s": 0.1,
            "correlation": 0.5,
        },
        {"distribution": "exponential", "mean_s": 0.1, "offset_s": 0.1, "correlation": 0.5},
        {"distribution": "empirical", "samples_s": [0.1, 0.2], "correlation": 0.5},
        {"distribution": "trace", "times_s": [0.0, 1.0], "delays_s": [0.1, 0.2], "period_s": 2.0},
    ],
    "loss": [
        {"model": "random", "probability": 0.1, "correlation": 0.5},
        {"model": "gilbert_elliott", "p": 0.1, "r": 0.5, "loss_in_bad": 0.9, "loss_in_good": 0.1},
        {"model": "four_state", "p13": 0.1, "p31": 0.5, "p32": 0.1, "p23": 0.5, "p14": 0.1},
        {"model": "trace", "losses": [0, 1]},
        {"model": "every_nth", "n": 10},
    ],
    "duplicate": [{"probability": 0.1}],
    "corrupt": [{"probability": 0.1}],
    "reorder": [{"probability": 0.1, "gap": 5}],
    "rate": [{"bits_per_s": 1000, "overhead_bytes": 8, "cell_bytes": 48, "cell_overhead_bytes": 5}],
    "queue": [{"messages": 10, "bytes": 1000}],
    "slots": [{"min_s": 0.1, "max_s": 0.2, "messages": 1, "bytes": 1500}],
}

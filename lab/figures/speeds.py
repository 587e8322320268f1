"""How fast the robots are."""

from matplotlib.figure import Figure

from formnet.lab.runs.recording import Collected


def speeds(run: Collected) -> Figure:
    """Every robot's speed over time."""
    figure = Figure()
    axes = figure.subplots()
    axes.plot(run.trajectories.t_s, run.trajectories.states[..., 3])
    return figure


FIGURES = {"speed-of-robots": speeds}

"""What is used of matplotlib. Nothing else imports it: see :mod:`lab.figures.unconfigured`."""

from formnet.lab.figures import unconfigured  # noqa: F401 (before matplotlib)

# isort: split
from matplotlib import style as style
from matplotlib.axes import Axes as Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg as FigureCanvasAgg
from matplotlib.collections import LineCollection as LineCollection
from matplotlib.figure import Figure as Figure
from matplotlib.lines import Line2D as Line2D

"""Parameters of a scenario from logs of the real thing: fits, intervals, and what the data cannot tell.

>>> from magwire_env import Scenario
>>> from magwire_env.identification import identify, record
>>> sc = Scenario.paper()
>>> log = record(sc.replace(contact__friction=0.08), seconds=6.0)  # or Log.load("measured.csv")
>>> found = identify(sc, log, ["friction"])
>>> 0.08 in found.interval("friction"), abs(found.value("friction") - 0.08) < 0.004
(True, True)
"""

from .identified import Identified, identify
from .logs import MEASURED, Log
from .parameters import PARAMETERS
from .pictures import residual_plot
from .recording import from_minari, record
from .twins import twins

__all__ = ["MEASURED", "PARAMETERS", "Identified", "Log", "from_minari", "identify", "record", "residual_plot", "twins"]

# What other rooms use of this one.

from .live import LiveView as LiveView
from .report import size_in_words as size_in_words
from .result import RunFailedError as RunFailedError
from .result import RunInterrupted as RunInterrupted
from .result import RunResult as RunResult
from .result import result_of as result_of
from .scenario import GroupOutline as GroupOutline
from .scenario import Outline as Outline
from .scenario import Scenario as Scenario
from .scenario import load as load
from .stepping import SteppedSimulation as SteppedSimulation
from .sweep_result import SweepResult as SweepResult
from .sweeps import checked as checked
from .sweeps import open_sweep as open_sweep
from .sweeps import opened as opened
from .sweeps import scenario_of as scenario_of
from .sweeps import sweep as sweep
from .sweeps import verify_sweep as verify_sweep

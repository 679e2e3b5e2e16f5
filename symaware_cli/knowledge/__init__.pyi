# What other rooms use of this one.

from .abstraction.bisimulation import Bisimulation as Bisimulation
from .abstraction.bisimulation import bisimulation as bisimulation
from .abstraction.knowledge_model import KnowledgeModel as KnowledgeModel
from .abstraction.transition_system import TransitionSystem as TransitionSystem
from .cell_map import draw_models as draw_models

# What worlds of other engines use of this room.

from .contact_tracker import GROUND as GROUND
from .ground import GroundPlane as GroundPlane
from .hull_check import warn_of_hulls as warn_of_hulls
from .physics import BodyStates as BodyStates
from .physics import PhysicsEnvironment as PhysicsEnvironment

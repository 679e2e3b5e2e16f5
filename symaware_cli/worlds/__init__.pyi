# What worlds of other engines use of this room.

from .colours import body_colour as body_colour
from .contact_tracker import GROUND as GROUND
from .contact_tracker import ContactTracker as ContactTracker
from .ground import GroundPlane as GroundPlane
from .hull_check import warn_of_hulls as warn_of_hulls
from .physics import BodyStates as BodyStates
from .vehicles import VehicleEnvironment as VehicleEnvironment

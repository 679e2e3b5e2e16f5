# What worlds of other engines use of this room.

from .colours import body_colour as body_colour
from .contact_tracker import GROUND as GROUND
from .contact_tracker import pair as pair
from .ground import GroundPlane as GroundPlane
from .physics import BodyStates as BodyStates
from .vehicles import VehicleEnvironment as VehicleEnvironment

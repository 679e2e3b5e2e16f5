# What worlds of other engines use of this room.

from .contact_tracker import GROUND as GROUND
from .contact_tracker import pair as pair
from .ground import GroundPlane as GroundPlane
from .physics import BodyStates as BodyStates
from .physics import PhysicsEnvironment as PhysicsEnvironment
from .vehicles import VehicleEnvironment as VehicleEnvironment

# What other rooms use of this one.

from .asset import AssetFolders as AssetFolders
from .asset import Robot as Robot
from .asset_error import AssetError as AssetError
from .convexity import is_convex as is_convex
from .mechanism import Mechanism as Mechanism
from .mechanism import Motor as Motor
from .mechanism import Placed as Placed
from .mechanism import Posture as Posture
from .mechanism import Postures as Postures
from .mesh_file import LARGEST_FILE as LARGEST_FILE
from .mesh_file import MEDIA_TYPES as MEDIA_TYPES
from .mesh_file import SUFFIXES as SUFFIXES
from .mesh_file import content as content
from .mesh_file import is_binary_stl as is_binary_stl
from .mesh_file import normalised as normalised
from .mesh_file import parse_mesh as parse_mesh
from .mesh_file import read_mesh as read_mesh
from .mesh_file import stl as stl
from .mjcf import MjcfDescription as MjcfDescription
from .robot_joint import RobotJoint as RobotJoint
from .urdf import MimicJoint as MimicJoint
from .urdf import RobotDescription as RobotDescription
from .urdf import material_colour as material_colour
from .vehicle import Vehicle as Vehicle
from .vehicle import VehicleBodies as VehicleBodies
from .xml_tree import XmlElement as XmlElement

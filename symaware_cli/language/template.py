"""The scenario that ``symaware new`` writes."""

from __future__ import annotations

import re
from string import Template

#: Where the comments begin.
_COMMENTS = 33

_YAML = Template("""\
# $name: what to look for when it runs.
# Check it with `symaware validate $name.yaml`, run it with `symaware run $name.yaml`.
symaware: 1                      # version of the scenario format
$name_line# names the log
seed: 1                          # the same seed gives the same run, byte for byte

run:
  duration: 20.0                 # simulated time [s]

environment:
  use: kinematic                 # `symaware list environments` lists all
  with: {time_step: 0.05}        # [s]

agents:
  robot:                         # a group; its agents are robot.0, robot.1 and so on
    count: 3
    entity: {shape: {circle: {radius: 0.3}}}            # [m]
    model: {use: unicycle, with: {max_speed: 1.0}}      # [m/s]; `symaware show unicycle` lists all parameters
    # One state for all, a list with one for each, or a seeded distribution as here: x [m], y [m], heading [rad].
    state: [{uniform: [-4, 4]}, {uniform: [-4, 4]}, {uniform: [-3.14, 3.14]}]
    knowledge:
      goal: [[5, 0], [0, 5], [-5, 0]]                   # one for each agent [m]
    components:                  # each takes one turn a step, in this order
      sense: {use: perception.self}
      steer: {use: control.go-to-goal, with: {speed: 0.8}}
""")

_TOML = Template("""\
# $name: what to look for when it runs.
# Check it with `symaware validate $name.toml`, run it with `symaware run $name.toml`.
symaware = 1                     # version of the scenario format
$name_line# names the log
seed = 1                         # the same seed gives the same run, byte for byte

[run]
duration = 20.0                  # simulated time [s]

[environment]
use = "kinematic"                # `symaware list environments` lists all
with = {time_step = 0.05}        # [s]

[agents.robot]                   # a group; its agents are robot.0, robot.1 and so on
count = 3
entity = {shape = {circle = {radius = 0.3}}}            # [m]
model = {use = "unicycle", with = {max_speed = 1.0}}    # [m/s]; `symaware show unicycle` lists all parameters
# One state for all, a list with one for each, or a seeded distribution as here: x [m], y [m], heading [rad].
state = [{uniform = [-4, 4]}, {uniform = [-4, 4]}, {uniform = [-3.14, 3.14]}]

[agents.robot.knowledge]
goal = [[5, 0], [0, 5], [-5, 0]]                        # one for each agent [m]

[agents.robot.components]        # each takes one turn a step, in this order
sense = {use = "perception.self"}
steer = {use = "control.go-to-goal", with = {speed = 0.8}}
""")


class TemplateError(Exception):
    """The name of a new scenario is invalid."""


def template(name: str, *, toml: bool = False) -> str:
    """Return a commented scenario with a name.

    Raises:
        TemplateError: The name is invalid.
    """
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_-]{0,63}", name):
        raise TemplateError(f"`{name}` is not a name: expected a letter or _, then letters, digits, _ or -")
    name_line = f'name = "{name}" ' if toml else f"name: {name} "
    return (_TOML if toml else _YAML).substitute(name=name, name_line=name_line.ljust(_COMMENTS))

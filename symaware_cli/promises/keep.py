"""A fault that makes agents keep a promise, regardless of the control inputs that they request.

Reasons: docs/decisions/0090-explanations.md
"""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import Field

from symaware_cli import core
from symaware_cli.core.identifiers import AgentPattern, Name
from symaware_cli.engine import AgentSelection, Array, Fault, FaultContext, FaultTargets, Restraint
from symaware_cli.geometry import Mask, Pieces, Separation, separation_from_points
from symaware_cli.promises.promise import SECTION, Promises
from symaware_cli.world import integrate

#: How far from the edge an agent is held, so that rounding never takes it out of the region [m].
_MARGIN = 1e-7

#: An agent is within a region if it is no farther outside than this [m].
_TOLERANCE = 1e-9


class Keep(Fault, Restraint):
    """Agents keep a promise: they do not leave the region in which they promised to stay.

    It is as if the region ended at a wall that only these agents meet, which stops what would lead out of it and
    nothing else. If a step under the requested control input would lead out, the control input is replaced by the one
    that follows the velocity to the nearest point of the region, as far as the model can follow a velocity. What then
    still leads out, by inertia or process noise, is undone: the position is moved to the nearest point of the region,
    and a velocity in the state loses its part out of it. An agent that is outside is not held back until it is
    inside, and sudden changes of its state are none of its steps.
    """

    class Parameters(core.Parameters):
        """A promise that is kept."""

        promise: Name = Field(description="The name of the promise.")
        of: AgentPattern = Field("*", description="Which of the agents that made it keep it; by default all.")

    restrained: AgentSelection
    #: The region of each of these agents.
    sets: Pieces

    @property
    def source(self) -> str:
        """The agents that keep it."""
        return f"agents.{self.parameters.of}"

    @property
    def text(self) -> str:
        """Names the promise."""
        return f"lets the promise {self.parameters.promise} be kept"

    def resolve(self, context: FaultContext) -> None:
        """Find the promise and the agents that made it, and check that they can be held back."""
        name = self.parameters.promise
        sections = [each.sections.get(SECTION) for each in context.groups]
        known = next((each.promises for each in sections if isinstance(each, Promises)), ())
        made = {each.of: each for each in known if each.name == name}
        if not made:
            context.refuse_unknown("promise", name, dict.fromkeys(each.name for each in known), "promise")
        found = [
            AgentSelection(group, [row for row in rows if group.ids[row] in made])
            for group, rows in context.agents(self.parameters.of, "of")
        ]
        # A promise is made by one agent, or by agents of one group.
        chosen = next((each for each in found if each.rows), None)
        if chosen is None:
            said = f"{context.quoted(self.parameters.of)} did not make the promise {context.quoted(name)}"
            context.refuse(said, "of", expected=f"one of {', '.join(made)}")
        context.require_pushes()
        group = chosen.group
        if "co-simulation" in group.model.needs:
            said = f"the states of {context.quoted(group.name)} are those of a program, and cannot be changed"
            context.refuse(said, "promise", code="unsuitable")
        self.restrained = chosen
        self.sets = Pieces.of(made[group.ids[row]].piece for row in chosen.rows)

    def begin(self, run: FaultTargets) -> Any:
        """Hold the agents back from now on."""
        run.restrain(self)

    def end(self, run: FaultTargets, begun: Any) -> None:
        """Let them go."""
        run.release(self)

    def request(self, states: Array, inputs: Array, step: float) -> Array:
        """See `Restraint`: steer along the edge instead of out of the region."""
        model = self.restrained.group.model
        found = self._from_region(integrate(model, states, model.limit(inputs), step))
        leaving = np.flatnonzero(self._inside(states) & (found.distance > 0.0))
        if not len(leaving):
            return inputs
        position = model.positions(states)[leaving]
        velocity = np.zeros_like(position)
        velocity[:, :2] = (found.second[leaving] - position[:, :2]) / step
        try:
            followed = model.follow_velocity(states[leaving], velocity)
        except NotImplementedError:
            return inputs
        replaced = inputs.copy()
        replaced[leaving] = followed
        return replaced

    def reach(self, before: Array, after: Array) -> Array:
        """See `Restraint`: undo what led out of the region."""
        found = self._from_region(after)
        left = np.flatnonzero(self._inside(before) & (found.distance > 0.0))
        if not len(left):
            return after
        model, held = self.restrained.group.model, after.copy()
        nearest = found.second[left]
        way = model.positions(after)[left, :2] - nearest
        middle = self.sets.vertices[left].mean(axis=1) - nearest
        # Towards an inner point, as a way along the normal might leave a region with an acute corner.
        length = np.sqrt((middle * middle).sum(axis=1))
        inwards = middle * (_MARGIN / np.maximum(length, _MARGIN))[:, None]
        held[np.ix_(left, np.array(model.position[:2]))] = nearest + inwards
        if model.velocities:
            columns = np.ix_(left, np.array(model.velocities[:2]))
            squared = np.maximum((way * way).sum(axis=1), np.finfo(float).tiny)
            out = np.maximum((held[columns] * way).sum(axis=1), 0.0) / squared
            held[columns] -= out[:, None] * way
        return held

    def _inside(self, states: Array) -> Mask:
        inside: Mask = self._from_region(states).distance <= _TOLERANCE
        return inside

    def _from_region(self, states: Array) -> Separation:
        points = self.restrained.group.model.positions(states)[:, :2]
        return separation_from_points(points, np.zeros(len(points)), self.sets)

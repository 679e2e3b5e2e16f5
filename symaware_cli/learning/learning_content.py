"""The entries of the section `learning` of scenarios."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from symaware_cli.geometry import AssetPath
from symaware_cli.language import Section


class NearestOthers(Section):
    """The nearest others that an agent is aware of, relative to its believed position; zeros if there are fewer."""

    nearest: int = Field(ge=1, le=1000, description="Number of others.")
    of: list[Literal["position", "velocity", "distance", "present"]] = Field(
        ["position", "velocity"],
        min_length=1,
        description="Quantities of each: its position relative to the agent's [m], its velocity [m/s], its distance "
        "[m], and 1 if there is one.",
    )


class SignalValues(Section):
    """A signal of a component, or a part of awareness; numbers that were never written are 0."""

    signal: str = Field(
        min_length=1, max_length=200, description="Name of the signal, such as `scan.ranges` or `attention`."
    )


class RewardTerm(Section):
    """A term of the reward."""

    value: str | None = Field(None, max_length=500, description="An expression, such as `-distance(position, goal)`.")
    specification: str | None = Field(None, description="A specification of the scenario: its robustness.")
    of: Literal["truth", "belief"] = Field("truth", description="States to which the expression refers.")
    as_: Literal["value", "change", "verdict"] = Field(
        "value",
        alias="as",
        description="The value at each step, its change since the previous step, or, of a specification, the "
        "robustness at the step of its verdict and 0 at all others.",
    )
    weight: float = Field(1.0, description="A factor.")
    limit: float = Field(10.0, gt=0, description="The greatest magnitude that a robustness counts with.")

    @model_validator(mode="after")
    def _one_of(self) -> RewardTerm:
        if (self.value is None) == (self.specification is None):
            raise ValueError("a term has either a value or a specification")
        if self.as_ == "verdict" and self.specification is None:
            raise ValueError("only a specification has a verdict")
        return self


class ActionBounds(Section):
    """The bounds of actions, within those of the model."""

    low: float | list[float] | None = Field(None, description="The least control input, one number or one for each.")
    high: float | list[float] | None = Field(None, description="The greatest, likewise.")


class LearningUse(Section):
    """A scenario as an environment of reinforcement learning."""

    agents: str | list[str] = Field(description="The agents that learn: a group, an agent, or several of these.")
    observation: list[str | NearestOthers | SignalValues] = Field(
        ["state"],
        min_length=1,
        description="Observations of an agent, in this order: expressions about its beliefs, as in conditions of "
        "components, its nearest others, and signals.",
    )
    action: ActionBounds = Field(ActionBounds(), description="The bounds of the control inputs that are actions.")
    reward: str | RewardTerm | list[str | RewardTerm] = Field(
        [], description="Terms that are added up. A text is the value of an expression about the true states."
    )
    terminate: str | None = Field(
        None, max_length=500, description="A condition about an agent's true state, after which its episode is over."
    )
    inputs: AssetPath | None = Field(
        None, description="A file with the actions of an episode, which are repeated; a recorded episode has one."
    )

    @property
    def terms(self) -> list[RewardTerm]:
        """The terms of the reward."""
        written = self.reward if isinstance(self.reward, list) else [self.reward]
        return [RewardTerm(value=each) if isinstance(each, str) else each for each in written]

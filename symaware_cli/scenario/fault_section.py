"""The sections of faults and other changes while a run goes on: when each begins, how long it lasts, what it does."""

from __future__ import annotations

from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from symaware_cli.geometry.shape import LARGEST, Number
from symaware_cli.scenario.section import AGENTS, Drawn, Name, Seconds, Section, Target, TriggerSection, Use

_COMPONENT = "A component of some agents, such as `robot.2.steer`, `robot.steer` for the whole group, or `*.steer`."


class Slowness(Section):
    """A component whose computations take longer."""

    of: Target = Field(description=_COMPONENT)
    latency: Seconds | Drawn = Field(
        description="Duration of a computation during the fault [s]; see the `latency` of a component."
    )


class Bias(Section):
    """A sensor that measures the agent's own state with an offset."""

    of: Target = Field(description=_COMPONENT)
    state: list[Number] = Field(
        min_length=1, description="Offset of the measured state, in the model's order and units."
    )


class Noise(Section):
    """A sensor that measures the agent's own state with noise."""

    of: Target = Field(description=_COMPONENT)
    deviation: list[Annotated[float, Field(ge=0, le=LARGEST)]] = Field(
        min_length=1,
        description="Standard deviations of the noise of the measured state, in the model's order and units.",
    )


class Loss(Section):
    """Messages that are lost."""

    sender: Target = Field("*", description=AGENTS)
    receiver: Target = Field("*", description=AGENTS)
    probability: float = Field(1.0, ge=0, le=1, description="Probability that a message is lost.")


class Delay(Section):
    """Messages that are delayed."""

    sender: Target = Field("*", description=AGENTS)
    receiver: Target = Field("*", description=AGENTS)
    by: float = Field(gt=0, le=1e9, description="Additional delay [s].")


class Severance(Section):
    """Links that lose all messages, in both directions."""

    between: tuple[Target, Target] = Field(description=f"The two ends of the links. {AGENTS}")


class Degradation(Section):
    """Links with additional losses and delays, or a lower bandwidth."""

    sender: Target = Field("*", description=AGENTS)
    receiver: Target = Field("*", description=AGENTS)
    loss: float = Field(0.0, ge=0, le=1, description="Probability of an additional loss.")
    delay: float = Field(0.0, ge=0, le=1e9, description="Additional delay of messages [s].")
    bandwidth: float | None = Field(
        None,
        gt=0,
        le=1e15,
        description="Upper limit of the bandwidth of each link [bytes/s]. By default there is no additional limit.",
    )

    @model_validator(mode="after")
    def _is_something(self) -> Self:
        if not self.loss and not self.delay and self.bandwidth is None:
            raise ValueError("say a `loss`, a `delay` or a `bandwidth`")
        return self


class Shove(Section):
    """A sudden change of the true state."""

    of: Target = Field(description=AGENTS)
    by: list[Number] = Field(min_length=1, description="Change of the true state, in the model's order and units.")


class Reconfiguration(Section):
    """A component with other parameters."""

    of: Target = Field(description=_COMPONENT)
    with_: dict[str, Any] = Field(
        min_length=1, alias="with", description="The parameters that change, in place of those under `with`."
    )


class Replacement(Use):
    """Another component in place of one; it has the same name and takes its turns at the same times."""

    of: Target = Field(description=_COMPONENT)


class Placement(Section):
    """A true state that is set."""

    of: Target = Field(description=AGENTS)
    state: list[Number] = Field(min_length=1, description="The new true state, in the model's order and units.")


class Information(Section):
    """Knowledge that is replaced."""

    of: Target = Field(description=AGENTS)
    knowledge: dict[Name, Any] = Field(
        min_length=1, description="The new values, by name; each of the same kind as the one that it replaces."
    )


class FaultUse(Section):
    """A fault: when it begins, its duration, and one of the kinds of faults."""

    at: float | None = Field(None, ge=0, le=1e9, description="When [s].")
    on: TriggerSection | None = Field(None, description="The event at whose first occurrence the fault begins.")
    for_: float | None = Field(
        None, alias="for", gt=0, le=1e9, description="Duration [s]. By default the rest of the run."
    )
    stop: Target | None = Field(None, description=f"Agents take no part; afterwards they restart. {AGENTS}")
    restart: Target | None = Field(None, description=f"Components are restarted. {_COMPONENT}")
    freeze: Target | None = Field(None, description=f"A component takes no turns. {_COMPONENT}")
    blind: Target | None = Field(None, description=f"A sensor sees no other agents. {_COMPONENT}")
    slow: Slowness | None = Field(None, description="A component whose computations take longer.")
    bias: Bias | None = Field(None, description="A sensor that measures the agent's own state with an offset.")
    noise: Noise | None = Field(None, description="A sensor that measures the agent's own state with noise.")
    drop: Loss | None = Field(None, description="Messages that are lost.")
    delay: Delay | None = Field(None, description="Messages that are delayed.")
    cut: Severance | None = Field(None, description="Links that lose all messages, in both directions.")
    degrade: Degradation | None = Field(
        None, description="Links with additional losses and delays, or a lower bandwidth."
    )
    partition: list[list[Target]] | None = Field(
        None,
        min_length=1,
        description="Sets of agents, each a list of ids, groups or patterns, that do not reach each "
        "other; all remaining agents form one more set.",
    )
    restore: Name | None = Field(None, description="The name of another fault that ends early.")
    push: Shove | None = Field(None, description="A sudden change of the true state, if the world supports it.")

    reconfigure: Reconfiguration | None = Field(
        None, description="Components that begin anew with other parameters, and afterwards with their own again."
    )
    replace: Replacement | None = Field(
        None, description="Another component that takes the turns of one; afterwards that one begins anew."
    )
    place: Placement | None = Field(
        None, description="A true state that is set, if the world supports sudden changes of it."
    )
    inform: Information | None = Field(None, description="Knowledge that is replaced, such as a goal.")

    @model_validator(mode="after")
    def _is_one(self) -> Self:
        if (self.at is None) == (self.on is None):
            raise ValueError("say when it comes: either `at` or `on`")
        given = [kind for kind in FAULTS if getattr(self, kind) is not None]
        if len(given) != 1:
            raise ValueError(f"say one thing that goes wrong: {', '.join(FAULTS)}")
        if self.for_ is not None and given[0] in INSTANTANEOUS:
            raise ValueError(f"a {given[0]} has no `for`: it happens at once")
        return self


#: The kinds of faults, by their keys.
FAULTS = (
    *("stop", "restart", "freeze", "blind", "slow", "bias", "noise"),
    *("drop", "delay", "cut", "degrade", "partition", "restore", "push"),
    *("reconfigure", "replace", "place", "inform"),
)

#: Those that have no duration.
INSTANTANEOUS = ("restart", "restore", "push", "place", "inform")

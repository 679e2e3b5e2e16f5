"""The section `learning` of scenarios: the learning agents, their observations and their rewards."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from symaware_cli.core import Plugin
from symaware_cli.engine import Simulation
from symaware_cli.language import Path, ScenarioSection, SectionContext
from symaware_cli.learning.given_inputs import GivenInputs, InputFileError
from symaware_cli.learning.learning_content import LearningUse
from symaware_cli.learning.learning_task import LearningTask


class LearningSection(ScenarioSection):
    """The specification of a scenario as an environment for reinforcement learning."""

    form: ClassVar[Any] = LearningUse | None
    description: ClassVar[str] = (
        "The scenario as an environment of Gymnasium or PettingZoo. A run does not use it, except for `inputs`."
    )

    def build(self, written: Any, context: SectionContext) -> LearningTask | None:
        """Read the file of actions; everything else is checked with the whole scenario."""
        content: LearningUse | None = None if context.document is None else context.document.learning
        if content is None:
            return None
        inputs = None
        if content.inputs is not None:
            try:
                inputs = GivenInputs.read(context.folder, content.inputs)
            except InputFileError as error:
                context.report(str(error), "inputs", code="missing-file" if error.is_missing else "unsuitable")
        return LearningTask(content, inputs, context.document.specifications)

    def plugins(self, built: LearningTask | None) -> Mapping[Path, Plugin]:
        """Return the task, which checks the scenario."""
        return {} if built is None else {(): built}

    def files(self, built: LearningTask | None) -> Mapping[str, bytes]:
        """Return the file of actions."""
        return {} if built is None or built.inputs is None else {built.inputs.name: built.inputs.content}

    def connect(self, built: LearningTask | None, simulation: Simulation) -> None:
        """Let the actions of the file replace the control inputs that components request."""
        if built is not None and built.inputs is not None:
            simulation.overrides = built.inputs.overrides(simulation.groups)

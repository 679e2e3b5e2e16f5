"""Conformal uncertainty: regions around the predicted positions of others, and the metric that calibrates them.

Reasons: docs/decisions/0037-conformal-regions.md
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from symaware_cli.core import (
    AgentGroup,
    GroupComponent,
    Level,
    Metric,
    Parameters,
    Part,
    Quantity,
    Signal,
    TimeSeries,
    Tracks,
)
from symaware_cli.engine.components.calibration import Calibration, read_errors
from symaware_cli.engine.components.prediction import predicted_positions
from symaware_cli.geometry import Array, AssetPath, Indices, lengths
from symaware_cli.world import SECOND, nanoseconds

#: The most look-aheads: of each turn as many predictions are kept until their times have come.
_MOST_AHEAD = 1000

#: The region of another: at each time its centre, then radius and coverage.
REGION = Part("region", "series", drawn=None, description="where others will be, with a probability of `coverage`")

#: The greatest errors so far.
ERROR = Signal(
    "prediction_error",
    "table",
    [Quantity("ahead", "s"), Quantity("error", "m")],
    drawn=None,
    description="the greatest so far, up to each look-ahead from the one before",
)

P_VALUE = Signal("p_value", columns=[Quantity("p_value", "1")], description="of the greatest errors so far")


class PredictedTracks(NamedTuple):
    """The predictions of a turn.

    Attributes:
        time: The instant of the turn [ns].
        keys: The number of each pair of an agent and another, ascending; shape (m,).
        places: The predicted positions of the other at that instant and at each look-ahead [m]; shape (H + 1, m, d).
    """

    time: int
    keys: Indices
    places: Array


class ConformalTurn(NamedTuple):
    """The result of a turn.

    Attributes:
        tracks: The others that are predicted.
        predictions: The predictions of this turn, and those of earlier turns for future instants.
        errors: The greatest error of each agent so far, at each look-ahead [m]; shape (n, H).
    """

    tracks: Tracks
    predictions: tuple[PredictedTracks, ...]
    errors: Array


class CalibrationFile(Parameters):
    """The table of a sweep."""

    file: AssetPath = Field(
        description="The table `runs.parquet` of a sweep of this scenario, with the metric `prediction.error`; below "
        "the scenario's folder."
    )
    column: str = Field("prediction_error", description="The name of that metric in the sweep.")


class ConformalUncertainty(GroupComponent):
    """Regions in which others will be with a given probability, calibrated from earlier runs (conformal prediction).

    Each agent predicts the others that it is aware of: they follow the intents that they have sent, or keep their
    velocities. At later turns it compares its predictions with the positions that it then believes them to have.
    Without a `calibration` it records these errors only, and the metric `prediction.error` puts them into the table of
    a sweep. With that table, it writes a region of each other to the awareness of it: a disc or ball around the
    predicted position for each look-ahead. With a probability of at least `coverage`, all predictions of a run, of all
    turns and others and up to each look-ahead, hold together; nothing is assumed but that the run is like those of the
    table: of the same distribution, and no longer.

    If the errors during a run are greater than those of nearly all earlier runs, this is no such run, and an event
    says so. In a run that is like those of the table this happens with a probability of at most `false_alarm`.
    """

    sees_world = True
    uncaptured: ClassVar = ("_calibration",)
    parts = (REGION,)
    signals = (ERROR, P_VALUE)
    events: ClassVar[Mapping[str, str]] = {
        "calibration-shifted": "Predictions err more than in nearly all runs that calibrated the regions."
    }

    _calibration: Calibration | None = None

    class Parameters(Parameters):
        """The predictions, and the runs that calibrate the regions."""

        calibration: CalibrationFile | None = Field(
            None, description="Earlier runs; if null, errors are recorded and there are no regions."
        )
        coverage: float = Field(
            0.9, gt=0, lt=1, description="Least probability that all predictions of a run are within their regions."
        )
        horizon: float = Field(2.0, gt=0, description="How far ahead to predict [s].")
        step: float = Field(0.25, gt=0, description="Time between two look-aheads, which divides the horizon [s].")
        reach: float = Field(10.0, gt=0, description="Others farther away are not predicted [m].")
        follow_intents: bool = Field(
            True,
            description="Whether others are expected to follow their intents, instead of keeping their velocities.",
        )
        shaping_runs: int = Field(
            0,
            ge=0,
            description="How many runs of the table, the first ones, determine how regions grow with the look-ahead; "
            "the others calibrate. If 0, regions grow in proportion to it.",
        )
        false_alarm: float = Field(
            0.02, gt=0, lt=1, description="Greatest probability of a false alarm that the calibration has shifted."
        )

        @model_validator(mode="after")
        def _whole_steps(self) -> ConformalUncertainty.Parameters:
            if nanoseconds(self.horizon) % nanoseconds(self.step):
                raise ValueError(f"step ({self.step:g}) must divide the horizon ({self.horizon:g})")
            if nanoseconds(self.horizon) // nanoseconds(self.step) > _MOST_AHEAD:
                said = f"horizon ({self.horizon:g}) has more than {_MOST_AHEAD:,} steps of {self.step:g}"
                raise ValueError(said)
            return self

    def check(self, group: AgentGroup) -> None:
        """Read the calibration."""
        self._calibration = None
        parameters, named = self.parameters, self.parameters.calibration
        if named is None or not (group.folder / named.file).is_file():
            return  # that a file is missing is reported where it is named
        table = read_errors(group.folder / named.file, named.file, named.column)
        ahead = self._ahead / SECOND
        if table.ahead.tolist() != ahead.tolist():
            raise ValueError(
                f"`{named.file}` has {len(table.ahead)} look-aheads up to {table.ahead[-1]:g} s, and `horizon` and "
                f"`step` ask for {len(ahead)} up to {ahead[-1]:g} s"
            )
        self._calibration = Calibration(table, parameters.coverage, parameters.shaping_runs)
        least = 1.0 / (len(self._calibration.scores) + 1)
        if parameters.false_alarm < least:
            raise ValueError(
                f"`false_alarm` is at least {least:.3g} with {len(self._calibration.scores)} runs that calibrate"
            )

    def series_quantities(self, group: AgentGroup) -> Mapping[str, Sequence[Quantity]]:
        """Declare centre, radius and coverage of a region."""
        centre = [Quantity(group.model.state[index].name, "m") for index in group.model.position]
        return {REGION.name: [*centre, Quantity("radius", "m"), Quantity("coverage", "1")]}

    def initialise_component(self, group: AgentGroup) -> None:
        """Start without predictions."""
        super().initialise_component(group)
        self._predictions: tuple[PredictedTracks, ...] = ()
        self._errors = np.zeros((len(group), len(self._ahead)))
        self._is_shifted = np.zeros(len(group), bool)

    @property
    def _ahead(self) -> NDArray[np.int64]:
        """The look-aheads [ns]; shape (H,)."""
        step = nanoseconds(self.parameters.step)
        return np.arange(step, nanoseconds(self.parameters.horizon) + 1, step)

    def _compute(self) -> ConformalTurn:
        group, now, ahead = self._group, self.now, self._ahead
        tracks = group.others(self.parameters.reach).at(now)
        keys = tracks.observers * len(self.environment.roster) + tracks.others
        going = tuple(each for each in self._predictions if now - each.time <= ahead[-1])
        errors = self._errors.copy()
        for each in going:
            passed = now - each.time
            if not passed:
                continue
            then, present = _common(each.keys, keys)
            place = int(np.searchsorted(ahead, passed))  # the first look-ahead that is not before
            share = 1.0 - (ahead[place] - passed) / nanoseconds(self.parameters.step)
            before, after = each.places[place, then], each.places[place + 1, then]
            error = lengths(tracks.positions[present] - (before + share * (after - before)))
            np.maximum.at(errors[:, place], tracks.observers[present], error)
        instants = [now, *(now + ahead).tolist()]
        places = predicted_positions(group, tracks, now, instants, self.parameters.follow_intents)
        return ConformalTurn(tracks, (*going, PredictedTracks(now, keys, places)), errors)

    def _update(self, value: ConformalTurn) -> None:
        self._predictions, self._errors = value.predictions, value.errors
        ahead = self._ahead / SECOND
        self.record(ERROR, [np.column_stack([ahead, errors]) for errors in value.errors])
        if self._calibration is not None:
            self._write_regions(value, self._calibration)
            self._test(self._calibration)

    def _write_regions(self, value: ConformalTurn, calibration: Calibration) -> None:
        group, roster, latest = self._group, self.environment.roster, value.predictions[-1]
        size = len(group.model.position)
        regions = np.empty((len(value.tracks), len(calibration.radii) + 1, size + 2))
        regions[:, :, :size] = np.moveaxis(latest.places[:, :, :size], 0, 1)
        regions[:, :, size] = [0.0, *calibration.radii]
        regions[:, :, size + 1] = calibration.coverage
        times = [latest.time, *(latest.time + self._ahead).tolist()]
        # Regions belong to pairs of agents, which have no columns.
        for row, agent in enumerate(group.agents):
            database, near = agent.awareness_database, slice(*value.tracks.pointers[row : row + 2].tolist())
            ids = [roster.ids[other] for other in value.tracks.others[near]]
            for id in sorted(set(database.held_part(REGION.name)).difference(ids)):
                database.set_part(REGION.name, id, TimeSeries())
            for id, region in zip(ids, regions[near], strict=True):
                database.set_part(REGION.name, id, TimeSeries.sampled(times, region))

    def _test(self, calibration: Calibration) -> None:
        """Say which agents meet errors that are too great for a run like those of the table."""
        p_values = calibration.p_values(self._errors)
        self.record(P_VALUE, p_values[:, None])
        shifted = (p_values <= self.parameters.false_alarm) & ~self._is_shifted
        for row in np.flatnonzero(shifted).tolist():
            place = int(np.argmax(self._errors[row] / calibration.radii))
            error, ahead = float(self._errors[row, place]), float(self._ahead[place] / SECOND)
            self.emit_for(
                row,
                "calibration-shifted",
                f"an error of {error:.3g} m at {ahead:g} s ahead, in a region of {calibration.radii[place]:.3g} m: at "
                f"most {p_values[row]:.2g} of runs like those that calibrated have as much",
                level=Level.WARNING,
                error=error,
                ahead=ahead,
                p_value=float(p_values[row]),
            )
        self._is_shifted |= shifted


def _common(one: Indices, other: Indices) -> tuple[Indices, Indices]:
    """Return the places of the keys that two ascending lists share."""
    if np.array_equal(one, other):
        every = np.arange(len(one))
        return every, every
    _, first, second = np.intersect1d(one, other, assume_unique=True, return_indices=True)
    return first, second


class PredictionError(Metric):
    """The greatest error of predictions of others in a run, for each look-ahead; from `uncertainty.conformal`."""

    kind = "series"
    unit = "m"

    class Parameters(Parameters):
        """Whose predictions."""

        group: str | None = Field(
            None, description="The group of agents that predict; may be omitted if there is only one."
        )

    def begin(self) -> None:
        """Find the component.

        Raises:
            ValueError: There is none, or more than one.
        """
        named = self.parameters.group
        found = [
            (group, name)
            for group in self.groups
            for name in group.awareness.signals
            if name.endswith(f".{ERROR.name}") and named in (None, group.name)
        ]
        if len(found) != 1:
            where = f"of `{named}`" if named else "of the scenario"
            many = "several `uncertainty.conformal`; name the `group`" if found else "no `uncertainty.conformal`"
            raise ValueError(f"the agents {where} have {many}")
        self._group, self._name = found[0]

    def value(self) -> list[tuple[float, float]] | None:
        """Return pairs of look-ahead [s] and error [m]; None if no turn was taken."""
        tables = [each for each in self._group.awareness[self._name] if len(each)]
        if not tables:
            return None
        greatest = np.max([each[:, 1] for each in tables], axis=0)
        return list(zip(tables[0][:, 0].tolist(), greatest.tolist(), strict=True))

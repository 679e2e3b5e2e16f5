"""Errors of pydantic become problems in the words of the file."""

from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
import yaml
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from symaware_cli.language.compose import Composition, compose
from symaware_cli.language.problem import Problem
from symaware_cli.language.source import Path as Place
from symaware_cli.language.validation import said_of, validate


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Wheel(_Model):
    radius: float = Field(gt=0, le=10, description="Radius [m].")


class Car(_Model):
    wheels: dict[Annotated[str, Field(pattern="^[A-Za-z_]+$")], Wheel] = Field(default_factory=dict)
    doors: int = Field(4, ge=2, description="How many doors.")
    mass: float | None = Field(None, description="Mass [kg]; unknown if null.")
    drive: Literal["front", "rear"] = "front"
    gears: list[float] = Field(default_factory=list, min_length=0, max_length=6, description="Ratios.")
    size: float | list[float] = Field(1.0, description="Size, or each side [m].")
    place: tuple[float, float] = (0.0, 0.0)
    electric: bool = False
    label: str = ""
    level: Literal[1, 2] = 1
    spare: Wheel | None = None
    axle: Wheel = Field(default_factory=lambda: Wheel(radius=1.0))
    colour: str = "red"

    @field_validator("colour")
    @classmethod
    def _known(cls, colour: str) -> str:
        if colour not in ("red", "blue"):
            raise ValueError("Only red and blue are left")
        return colour

    @model_validator(mode="after")
    def _fits(self) -> "Car":
        if self.doors > 4 and self.mass is None:
            raise ValueError("a car with so many doors needs a mass")
        return self


@pytest.fixture
def judged(tmp_path: Path) -> Any:
    """Check the content of a file against a model, and return the problems."""

    def judge(text: str, model: type[BaseModel] = Car, others: tuple[Place, ...] = ()) -> list[Problem]:
        path = tmp_path / "car.yaml"
        path.write_text(text)
        found = validate(model, yaml.safe_load(text), compose(path, name="car.yaml"), (), others)
        assert isinstance(found, list)
        return found

    return judge


@pytest.mark.parametrize(
    ("text", "message", "expected"),
    [
        ('doors: "4"', "`doors` is the text `4`", "a whole number, without quotes"),
        ("doors: four", "`doors` is the text `four`", "a whole number"),
        ("doors: 4.0", "`doors` is 4.0", "a whole number"),
        ("doors: 1", "`doors` is 1", "a whole number of at least 2"),
        ("doors: []", "`doors` is an empty list", "a whole number"),
        ("mass: true", "`mass` is true", "a number [kg]"),
        ('mass: "-1e3"', "`mass` is the text `-1e3`", "a number [kg], without quotes"),
        ("mass: 12 kg", "`mass` is the text `12 kg`", "a number [kg]"),
        ("electric: 1", "`electric` is 1", "true or false"),
        ('electric: "true"', "`electric` is the text `true`", "true or false, without quotes"),
        ("label: 12", "`label` is 12", "text, in quotes"),
        ("label:", "`label` is empty (null)", "text"),
        ("gears: 5", "`gears` is 5", "a list"),
        ("gears: [1, 2, 3, 4, 5, 6, 7]", "`gears` is a list of 7", "a list of at most 6"),
        ("gears: [1, {}]", "`gears[1]` is an empty mapping", "a number"),
        ("size: wide", "`size` is the text `wide`", "a number [m] or a list"),
        ("size: [1, wide]", "`size[1]` is the text `wide`", "a number [m]"),
        ("drive: 4", "`drive` is 4", "one of front, rear"),
        ('level: "2"', "`level` is the text `2`", "`2`, without quotes"),
        ("axle: 1", "`axle` is 1", "a mapping with `radius`"),
        ("wheels: [{radius: 1}]", "`wheels` is a list of 1", "a mapping that gives each a name"),
        ("wheels: {a: {radius: 0}}", "`wheels.a.radius` is 0", "a number greater than 0 [m]"),
        ("wheels: {a: {radius: 10.5}}", "`wheels.a.radius` is 10.5", "a number of at most 10 [m]"),
        ("wheels: {a: {}}", "the field `radius` is missing in `wheels.a`", "radius [m]"),
        ("spare: {}", "the field `radius` is missing in `spare`", "radius [m]"),
        ("spare: {radius: big}", "`spare.radius` is the text `big`", "a number [m]"),
        ("colour: green", "`colour` is the text `green`: only red and blue are left", None),
        ("doors: 5", "`doors`: a car with so many doors needs a mass", None),
    ],
)
def test_a_value_of_the_wrong_kind_is_reported_with_the_expected_one(
    judged: Any, text: str, message: str, expected: str | None
) -> None:
    (problem,) = judged(text)
    assert (problem.message, problem.expected) == (message, expected)
    assert problem.source_line == text
    assert problem.suggestion is None


def test_a_rule_over_two_fields_is_shown_at_their_section_and_one_over_a_single_field_at_the_field(judged: Any) -> None:
    class Garage(BaseModel):
        car: Car

    (problem,) = judged("car:\n  mass: null\n  doors: 5\n", Garage)
    assert (problem.path, problem.span.line, problem.source_line) == ("car", 1, "car:")
    (problem,) = judged("car:\n  label: x\n  doors: 5\n", Garage)
    assert (problem.path, problem.span.line) == ("car.doors", 3)


@pytest.mark.parametrize(
    ("text", "suggestion"), [("drive: font", "front"), ("electric: yes!", None), ("electric: 'Yes'", "true")]
)
def test_the_nearest_valid_name_is_suggested(judged: Any, text: str, suggestion: str | None) -> None:
    assert judged(text)[0].suggestion == suggestion


def test_a_misspelt_key_is_not_also_reported_as_missing(judged: Any) -> None:
    (problem,) = judged("axle: {radus: 1}\n")
    assert (problem.code, problem.path, problem.expected) == ("unknown-key", "axle.radus", "`radius`")


def test_a_key_that_is_not_like_any_is_reported_beside_the_missing_one(judged: Any) -> None:
    assert [problem.code for problem in judged("axle: {width: 1}\n")] == ["missing-field", "unknown-key"]


def test_a_misplaced_key_is_reported_with_its_proper_place(judged: Any) -> None:
    (problem,) = judged("axle: {radius: 1, doors: 5}\n")
    assert (problem.message, problem.expected) == ("unknown key `doors`", "it at the top level")
    (problem,) = judged("radius: 1\n")
    assert problem.expected in ("it under `axle`", "it under `spare`")
    (problem,) = judged("speed: 1\n", Car, (("motor", "with", "speed"),))
    assert problem.expected == "it under `motor.with`"


def test_a_similar_name_here_takes_precedence_over_an_equal_one_elsewhere(judged: Any) -> None:
    (problem,) = judged("door: 5\n", Car, (("motor", "with", "door"),))
    assert problem.suggestion == "doors"


def test_all_problems_are_found_at_once(judged: Any) -> None:
    problems = judged("doors: 1\nmass: heavy\nlabel: 1\nwheels: {a: {radius: -1}, 'b c': {radius: 1}}\nx: 1\n")
    assert sorted(problem.path for problem in problems) == [
        "doors",
        "label",
        "mass",
        "wheels.a.radius",
        "wheels.b c",
        "x",
    ]


def test_sound_data_becomes_the_model(tmp_path: Path) -> None:
    path = tmp_path / "car.yaml"
    path.write_text("doors: 2\n")
    composition: Composition = compose(path)
    car = validate(Car, composition.data, composition, ())
    assert isinstance(car, Car)
    assert car.doors == 2


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (None, "empty (null)"),
        (True, "true"),
        (3, "3"),
        (3.0, "3.0"),
        (1e-9, "1e-09"),
        (1e22, "1e+22"),
        ("x", "the text `x`"),
        ("", "an empty text"),
        ({}, "an empty mapping"),
        ({"a": 1}, "a mapping"),
        ([], "an empty list"),
        ([1, 2], "a list of 2"),
        ("y" * 200, f"the text `{'y' * 30}...{'y' * 30}`"),
    ],
)
def test_descriptions_of_values(value: object, said: str) -> None:
    assert said_of(value) == said

import pytest

from symaware_cli import TransitionSystem

CORRIDOR = {"a": ["a", "b"], "b": ["a", "c"], "c": ["c"]}


def test_a_system_is_made_from_names() -> None:
    system = TransitionSystem.of(CORRIDOR, initial=["a"], labels={"end": ["a", "c"]})
    assert system.states == ("a", "b", "c")
    assert system.initial == (0,)
    assert system.successors == ((0, 1), (0, 2), (2,))
    assert [sorted(system.observation(state)) for state in range(3)] == [["end"], [], ["end"]]


def test_a_system_survives_dot() -> None:
    system = TransitionSystem.of(CORRIDOR, initial=["a"], labels={"end": ["a", "c"], "left": ["a"]})
    assert TransitionSystem.from_dot(system.dot()) == system


def test_a_line_that_is_no_dot_is_named() -> None:
    with pytest.raises(ValueError, match=r"line 2 is not a node or an edge: a => b"):
        TransitionSystem.from_dot("digraph {\na => b\n}")
    with pytest.raises(ValueError, match=r"line 1 is not a node or an edge: .*; write one on each line"):
        TransitionSystem.from_dot("digraph { a -> b }")


def test_a_system_is_made_from_plain_data() -> None:
    data = {"transitions": CORRIDOR, "initial": ["b"], "labels": {"end": ["c"]}}
    assert TransitionSystem.from_data(data) == TransitionSystem.of(CORRIDOR, ["b"], {"end": ["c"]})
    with pytest.raises(ValueError, match="there is no state `d`"):
        TransitionSystem.from_data({"transitions": {"a": ["d"]}})
    with pytest.raises(ValueError, match="has no `edges`"):
        TransitionSystem.from_data({"transitions": CORRIDOR, "edges": []})


def test_in_a_product_both_move_at_each_step() -> None:
    light = TransitionSystem.of({"red": ["green"], "green": ["red"]}, ["red"], {"go": ["green"]})
    product = TransitionSystem.of(CORRIDOR, ["a"], {"end": ["c"]}).product(light)
    assert product.states[:3] == ("a,red", "a,green", "b,red")
    assert product.initial == (0,)
    assert [product.states[each] for each in product.successors[0]] == ["a,green", "b,green"]
    assert sorted(product.observation(5)) == ["end", "go"]
    with pytest.raises(ValueError, match="both have the label `go`"):
        light.product(light)

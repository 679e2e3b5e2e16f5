import pytest

from symaware_cli import TransitionSystem

CORRIDOR = {"a": ["a", "b"], "b": ["a", "c"], "c": ["c"]}


def test_a_system_is_made_from_names() -> None:
    system = TransitionSystem.of(CORRIDOR, initial=["a"], labels={"end": ["a", "c"]})
    assert system.states == ("a", "b", "c")
    assert system.initial == (0,)
    assert system.successors == ((0, 1), (0, 2), (2,))
    assert [sorted(system.labels_in(state)) for state in range(3)] == [["end"], [], ["end"]]


def test_a_system_survives_dot() -> None:
    system = TransitionSystem.of(CORRIDOR, initial=["a"], labels={"end": ["a", "c"], "left": ["a"]})
    assert TransitionSystem.from_dot(system.dot()) == system


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("digraph {\na => b\n}", "line 2, column 4: `>` cannot stand here"),
        ("digraph {\n a -> }", r"line 2, column 7: a name is expected here, not `}`"),
        ("graph { a -- b }", "line 1, column 1: a transition system is a directed graph"),
        ("digraph { a -- b }", "line 1, column 11: .* written with `->`"),
        ("digraph { a -> b", "line 1, column 17: a `}` is missing"),
        ("digraph { a [x=1 }", r"line 1, column 18: a name is expected here, not `}`"),
        ('digraph { "a -> b }', "line 1, column 11: this text is never closed with a quote"),
        ("digraph { /* a }", "line 1, column 11: this comment is never closed"),
        ("digraph { a [label=<b] }", "line 1, column 20: this text is never closed with `>`"),
        ("digraph {} {}", r"line 1, column 12: `{` follows the end"),
        ("digraph {}", "at least one state"),
        ("", "line 1, column 1: `digraph` is expected here, not the end"),
        ("digraph { a -> b; a -> b }", "line 1, column 19: the edge from `a` to `b` is there twice"),
        ("digraph { a -> init }", "no state precedes it"),
        ("digraph { " + "{" * 40 + "}" * 40 + " }", "nested more than 32 deep"),
    ],
)
def test_a_text_that_is_no_graph_is_refused_at_its_place(text: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        TransitionSystem.from_dot(text)


@pytest.mark.parametrize(
    "text",
    [
        "digraph { a -> a; a -> b; b -> a; b -> c; c -> c }",
        "digraph { a -> a -> b -> a b -> c -> c; }",
        "strict digraph G { a -> a -> b -> a; a -> b; b -> c -> c }",
        '\ufeffDigraph "G" {\n\ta -> {a b}; b -> {a c}; c -> c // the end\n}',
        'digraph { /* a\n comment */ a -> a\n# line\n a -> b [pos="e,27,108.41 27,143.83",\n  x=1]; b -> a; b->c;c->c}',
        (
            'digraph G {\n\tgraph [bb="0,0,54,180"];\n\tnode [label="\\N"];\n\ta\t[height=0.5,\n\t\tpos="27,162",\n'
            "\t\twidth=0.75];\n\ta -> a; a -> b; b -> a; b -> c; c -> c;\n}\n"
        ),
        "digraph { rankdir=LR; subgraph cluster_0 { color=blue; a; b } a:n -> a:s:_; a -> b; b -> a; b -> c; c -> c }",
        'digraph { "a" -> "a" -> "b" -> "\\\na"; "b" -> "c" -> "c" [label=<<b>c</b>>] }',
    ],
)
def test_all_that_graphviz_writes_is_read(text: str) -> None:
    system = TransitionSystem.from_dot(text)
    assert dict(zip(system.states, system.successors, strict=True)) == {"a": (0, 1), "b": (0, 2), "c": (2,)}
    assert system.initial == (0, 1, 2)


def test_labels_and_initial_states_are_attributes_and_arrows() -> None:
    system = TransitionSystem.from_dot(
        'digraph { node [labels="all"]; init [shape=point]; a; b [labels="x y"]; init -> b; a -> b -> a; }'
    )
    assert system.initial == (1,)
    assert system.labels == {"all": {0}, "x": {1}, "y": {1}}


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
    assert sorted(product.labels_in(5)) == ["end", "go"]
    with pytest.raises(ValueError, match="both have the label `go`"):
        light.product(light)


def test_a_system_has_an_observation_set_and_map_apart_from_its_labels() -> None:
    rooms = {"hall": ["hall", "lab"], "lab": ["lab", "attic"], "attic": ["lab"]}
    assert [TransitionSystem.of(rooms).observation(state) for state in range(3)] == ["hall", "lab", "attic"]
    data = {
        "transitions": rooms,
        "labels": {"work": ["lab"]},
        "observations": {"lit": ["hall", "lab"], "dark": ["attic"]},
    }
    system = TransitionSystem.from_data(data)
    assert system.observations == ("lit", "dark")
    assert [system.observation(state) for state in range(3)] == ["lit", "lit", "dark"]
    assert system.labels_in(1) == {"work"}
    assert TransitionSystem.from_dot(system.dot()) == system
    light = TransitionSystem.of({"red": ["green"], "green": ["red"]}, observations={"on": ["red", "green"]})
    assert system.product(light).observations == ("lit,on", "dark,on")
    assert system.product(light).observation(5) == "dark,on"
    assert system.avoiding([1]).observations == system.observations


@pytest.mark.parametrize(
    ("observations", "said"),
    [
        ({"lit": ["hall"]}, "`lab` has no observation"),
        ({"lit": ["hall", "lab"], "dark": ["lab"]}, "`lab` has two observations"),
        ({"lit": ["hall", "lab", "attic"]}, "no state `attic`"),
    ],
)
def test_each_state_has_one_observation(observations: dict[str, list[str]], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        TransitionSystem.of({"hall": ["lab"], "lab": ["hall"]}, observations=observations)

"""Knowledge is a dictionary that tracks its changes."""

import pytest

from symaware_cli import KnowledgeDatabase


def test_new_knowledge_counts_as_changed() -> None:
    assert KnowledgeDatabase().changed


CHANGES = {
    "set": lambda known: known.__setitem__("goal", 2),
    "remove": lambda known: known.__delitem__("goal"),
    "update": lambda known: known.update(goal=2),
    "merge": lambda known: known.__ior__({"goal": 2}),
    "pop": lambda known: known.pop("goal"),
    "popitem": lambda known: known.popitem(),
    "setdefault": lambda known: known.setdefault("map", 2),
    "clear": lambda known: known.clear(),
}


@pytest.mark.parametrize("how", CHANGES)
def test_every_way_to_change_it_is_noticed(how: str) -> None:
    known = KnowledgeDatabase({"goal": 1})
    known.changed = False
    CHANGES[how](known)
    assert known.changed
    assert dict(known) != {"goal": 1}


def test_reading_changes_nothing() -> None:
    known = KnowledgeDatabase({"goal": 1})
    known.changed = False
    assert known["goal"] == known.get("goal") == 1
    assert known.get("map") is None
    assert not known.changed


def test_unknown_keys_are_reported_with_the_known_ones() -> None:
    with pytest.raises(KeyError, match="does not know `gaol`; it knows goal, map"):
        KnowledgeDatabase({"map": 1, "goal": 2})["gaol"]
    with pytest.raises(KeyError, match="it knows nothing"):
        KnowledgeDatabase()["goal"]


def test_it_does_not_follow_the_mapping_it_was_made_from() -> None:
    entries = {"goal": 1}
    known = KnowledgeDatabase(entries)
    entries["goal"] = 2
    assert known["goal"] == 1

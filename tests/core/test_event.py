"""Events reach all subscribers, also if some subscribe, cancel or fail while one fires."""

from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from symaware_cli import Event
from symaware_cli.core import EventBus, SubscriberError, Subscription


def arrived(source: str = "agents.robot.0.steer", name: str = "arrived") -> Event:
    return Event(name, source, 0)


def test_subscribers_are_called_in_the_order_of_subscription() -> None:
    bus = EventBus()
    told: list[int] = []

    def note(number: int, event: Event) -> None:
        told.append(number)

    for number, name in enumerate(["arrived", "*", "arrived", "*", "arrived"]):
        bus.subscribe(name, partial(note, number))
    bus.fire(arrived())
    assert told == [0, 1, 2, 3, 4]


def test_an_event_fired_by_a_subscriber_is_delivered_after_its_cause_to_earlier_subscribers() -> None:
    bus, told = EventBus(), []
    bus.subscribe("*", lambda event: told.append(event.name))
    bus.subscribe("arrived", lambda event: bus.fire(arrived(name="celebrated")))
    bus.fire(arrived())
    assert told == ["arrived", "celebrated"]


def test_a_subscriber_added_while_an_event_fires_is_called_from_the_next_one_on() -> None:
    bus, told = EventBus(), []

    def add(event: Event) -> None:
        bus.subscribe("arrived", lambda event: told.append("added"))

    first = bus.subscribe("arrived", add)
    bus.fire(arrived())
    assert told == []
    first.cancel()
    bus.fire(arrived())
    assert told == ["added"]


def test_a_subscriber_cancelled_while_an_event_fires_is_not_called_any_more() -> None:
    bus, told = EventBus(), []
    bus.subscribe("arrived", lambda event: second.cancel())
    second = bus.subscribe("arrived", lambda event: told.append("second"))
    bus.fire(arrived())
    bus.fire(arrived())
    assert told == []


def test_a_subscriber_may_cancel_itself_and_cancel_twice() -> None:
    bus, told = EventBus(), []

    def once(event: Event) -> None:
        told.append(event.name)
        subscription.cancel()
        subscription.cancel()

    subscription = bus.subscribe("arrived", once)
    bus.fire(arrived())
    bus.fire(arrived())
    assert told == ["arrived"]


def test_other_subscribers_are_called_if_one_raises() -> None:
    bus, told = EventBus(), []

    def broken(event: Event) -> None:
        raise ZeroDivisionError("no")

    bus.subscribe("arrived", broken)
    bus.subscribe("arrived", lambda event: told.append("second"))
    with pytest.raises(SubscriberError, match=r"broken.*arrived.*agents\.robot\.0\.steer") as caught:
        bus.fire(arrived())
    assert told == ["second"]
    assert isinstance(caught.value.__cause__, ZeroDivisionError)
    assert caught.value.event.name == "arrived"


@pytest.mark.parametrize(
    ("pattern", "heard"),
    [
        ("*", True),
        ("agents.robot.0.steer", True),
        ("agents.robot.*", True),
        ("agents.*.steer", True),
        ("agents.robot.0", False),
        ("agents.robot.1.*", False),
        ("AGENTS.*", False),
    ],
)
def test_a_source_pattern_selects_events(pattern: str, heard: bool) -> None:
    bus = EventBus()
    told: list[Event] = []
    bus.subscribe("arrived", told.append, pattern)
    bus.fire(arrived())
    assert bool(told) == heard


def test_a_star_matches_every_event_that_does_not_recur() -> None:
    bus, told = EventBus(), []
    bus.subscribe("*", lambda event: told.append(event.name))
    for name in ("arrived", "computed", "stepping", "sent", "failed", "anything"):
        bus.fire(arrived(name=name))
    assert told == ["arrived", "failed", "anything"]


def test_an_event_without_subscribers_can_be_fired() -> None:
    EventBus().fire(arrived())


def test_events_of_muted_sources_are_not_delivered() -> None:
    bus, told = EventBus(), []
    bus.subscribe("*", lambda event: told.append(event.source))
    bus.mute({"agents.robot.0.steer"})
    bus.fire(arrived())
    bus.fire(arrived("agents.robot.1.steer"))
    bus.mute(())
    bus.fire(arrived())
    assert told == ["agents.robot.1.steer", "agents.robot.0.steer"]


def test_hot_paths_can_check_for_subscribers() -> None:
    bus = EventBus()
    assert not bus.wanted
    assert not bus.turns_wanted
    bus.subscribe("arrived", print)
    assert "arrived" in bus.wanted
    assert not bus.turns_wanted
    bus.subscribe("computed", print)
    assert bus.turns_wanted


@given(st.lists(st.tuples(st.sampled_from("sfcx"), st.integers(0, 9)), max_size=40))
def test_any_sequence_of_subscribing_cancelling_and_firing_calls_exactly_the_active_subscribers(
    steps: list[tuple[str, int]],
) -> None:
    bus = EventBus()
    told: list[int] = []
    active: list[int] = []
    subscriptions: list[Subscription] = []

    def note(number: int, event: Event) -> None:
        told.append(number)

    for what, number in steps:
        if what == "s":
            mine = len(subscriptions)
            subscriptions.append(bus.subscribe("arrived", partial(note, mine)))
            active.append(mine)
        elif what in "cx" and subscriptions:
            mine = number % len(subscriptions)
            subscriptions[mine].cancel()
            active = [each for each in active if each != mine]
        elif what == "f":
            told.clear()
            bus.fire(arrived())
            assert told == active


def test_a_component_that_subscribes_and_cancels_in_each_turn_takes_no_more_memory() -> None:
    class Listener:
        path = "agents.robot.listen"

        def hear(self, event: Event) -> None:
            """Nothing."""

    bus, listener = EventBus(), Listener()
    for _ in range(100):
        bus.subscribe("contact", listener.hear).cancel()
    assert [len(each) for each in bus._by_owner.values()] == [1]
    bus.cancel_all_of(listener)
    assert not bus._by_owner

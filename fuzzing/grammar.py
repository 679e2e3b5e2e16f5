"""Draws formulas and conditions."""

from __future__ import annotations

from fuzzing.draft import Draft

_SIGNS = ("<", "<=", ">", ">=")


class Grammar:
    """Draws formulas and conditions about a draft.

    A scope is what a formula is about: `each` and `belief` of an agent, `pairs`, or the `world`.
    """

    def __init__(self, draft: Draft) -> None:
        self._draft = draft

    def formula(self, scope: str, depth: int, *, ltl: bool = False) -> str:
        """A formula with at most so many operators above each other."""
        chance = self._draft.chance
        if depth == 0:
            return self.condition(scope)

        def below() -> str:
            return f"({self.formula(scope, depth - 1, ltl=ltl)})"

        window = "" if ltl or chance.random() < 0.4 else self._window()
        match chance.randrange(13):
            case 0:
                return f"not {below()}"
            case 1:
                return f"{below()} and {below()}"
            case 2:
                return f"{below()} or {below()}"
            case 3:
                return f"{below()} implies {below()}"
            case 4:
                return f"next {below()}"
            case 5:
                return f"weak next {below()}"
            case 6 | 7:
                return f"always{window} {below()}"
            case 8:
                return f"eventually{window} {below()}"
            case 9:
                return f"{below()} until{window} {below()}"
            case 10:
                return f"{below()} since{window} {below()}" if not ltl else f"eventually {below()}"
            case 11:
                return f"historically{window} {below()}" if not ltl else f"always {below()}"
        return f"once{window} {below()}" if not ltl else f"always eventually {below()}"

    def _window(self) -> str:
        chance, step = self._draft.chance, self._draft.step
        first = chance.choice([0, 0, 1, 3]) * step
        if chance.random() < 0.1:
            return f"[{first:.6g}, inf]"
        last = first + chance.choice([0, 1, 2, 5, 20, 100]) * step
        return f"[{first:.6g}, {last:.6g}]"

    def condition(self, scope: str) -> str:
        """A condition on one instant."""
        chance = self._draft.chance
        value = round(chance.uniform(-3, 3), 2)
        if chance.random() < 0.25:
            return self._truth(scope)
        number = self._number(scope)
        if chance.random() < 0.25:
            number = self._calculated(number, self._number(scope), value)
        match chance.randrange(12):
            case 0:
                return f"{value:g} < {number} <= {value + 2:g}"
            case 1:
                return f"{number} != {value}"
            case 2:
                return f"{number} == {value}"
        return f"{number} {chance.choice(_SIGNS)} {value}"

    def _number(self, scope: str) -> str:
        """A number with a name in a scope."""
        chance, draft = self._draft.chance, self._draft
        if scope == "pairs":
            names = ["distance", "closing_speed", 'speed["first"]', 'position["second"][0]', "time", "distance"]
            return chance.choice([*names, 'norm(velocity["first"])', 'distance(position["first"], [1, 1])'])
        if scope == "world":
            some = chance.choice([*draft.agents(), *draft.bodies()])
            names = ["time", "contacts", "agents", "min_separation", "highest_risk", "count(goals_reached)"]
            names += [f'position["{some}"][0]', f'state["{some}"][1]', f'norm(position["{some}"])']
            names += [f'count(present["{chance.choice(draft.groups())}"])']
            names += [f'signed_distance(position["{some}"], {self._region()})']
            return chance.choice([*names, f'robustness["{self._specification()}"]'])
        names = ["x", "y", "speed", "nearest", "position[0]", "norm(position)", "distance(position, goal)", "time"]
        names += ["state[1]", "control_input[0]", "norm(velocity)", "knowledge.goal[0]", 'knowledge["goal"][1]']
        names += [f"signed_distance(position, {self._region()})", "position[1]"]
        names += ["risk", "uncertainty"] if scope != "each" else []
        return chance.choice([*names, f'robustness["{self._specification()}"]'] if scope == "turn" else names)

    def _calculated(self, one: str, other: str, value: float) -> str:
        """A number that is calculated from one or two others."""
        ways = [
            *(f"abs({one})", f"max({one}, {value})", f"min({one}, {value})", f"{one} + {value}", f"{one} - {value}"),
            *(f"2 * {one}", f"{one} / 2", f"{one} % 0.5", f"{one} ** 2", f"-{one}", f"sqrt(abs({one}))"),
            *(f"sin({value})", f"cos({value})", f"wrap({value} * time)", f"atan2({one}, {one})", f"{one} - {other}"),
        ]
        return self._draft.chance.choice(ways)

    def _truth(self, scope: str) -> str:
        """A truth value with a name in a scope."""
        chance, draft = self._draft.chance, self._draft
        if scope == "pairs":
            return f'inside(position["{chance.choice(["first", "second"])}"], {self._region()})'
        if scope == "world":
            some = chance.choice([*draft.agents(), *draft.bodies(), *draft.groups()])
            word = chance.choice(["violated", "satisfied"])
            truths = ["all(goals_reached)", "any(goals_reached)", f'inside(position["{some}"], {self._region()})']
            truths += [f'all(present["{some}"])', f'all(position["{some}"] < 2)', f'any(position["{some}"] > 1)']
            return chance.choice([*truths, f'{word}["{self._specification()}"]'])
        truths = [f"inside(position, {self._region()})", "all(position < 2)", "any(velocity > 0.5)"]
        truths += ["has_intent"] if scope != "each" else []
        word = chance.choice(["violated", "satisfied"])
        return chance.choice([*truths, f'{word}["{self._specification()}"]'] if scope == "turn" else truths)

    def _region(self) -> str:
        return str(self._draft.chance.choice(sorted(self._draft.tree["regions"])))

    def _specification(self) -> str:
        return str(self._draft.chance.choice([*self._draft.tree["specifications"], "s0"]))

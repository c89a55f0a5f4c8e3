"""What fills chambers and sags: gas by what stages shut, fill and join, and liquids of given volume, for the engine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from taichi_membrane.mechanics.contents import Contents
from taichi_membrane.mechanics.gas import ShutChamber, amount_of
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.system import System
from taichi_membrane.scene import Stage
from taichi_membrane.scene.drivers import driver_names, shut_by
from taichi_membrane.simulation.load_state import LoadState
from taichi_membrane.simulation.model import Model


class Filling:
    """The contents of one model's chambers and sags, by the values of its drivers.

    :param let_out: amount of gas that relief valves have let out since the stage began, by the first name of each gas.
    """

    def __init__(self, model: Model, system: System) -> None:
        self.model, self.system = model, system
        self.let_out: dict[str, float] = {}
        self._gases: tuple[tuple[str, ...], ...] = ()
        count = model.structure.chamber_count
        ponds = {name: model.surface.pond(name, 0.0) for name in model.surface.volumes}
        self.waters = {name: replace(pond, number=count + pond.number) for name, pond in ponds.items()}
        self.contents = Contents(system, (), tuple(self.waters.values())) if self.waters else None

    def shut(self, stage: Stage, let_out: Mapping[str, float] | None = None) -> None:
        """Shut the valves that a stage shuts and open its tubes; open all other valves.

        :param let_out: what relief valves have let out in the stage's load steps so far.
        """
        self.let_out = dict(let_out or {})
        tubes = {name: tuple(tube) for tube in stage.joined for name in tube}
        gases = [tubes.get(name, (name,)) for name in shut_by(self.model.scene, stage)]
        self._gases = tuple(dict.fromkeys(gases))
        chambers, ponds = tuple(map(self._chamber, self._gases)), tuple(self.waters.values())
        self.contents = Contents(self.system, chambers, ponds) if chambers or ponds else None

    def _chamber(self, names: tuple[str, ...]) -> ShutChamber:
        """The chambers that one gas fills, with nothing in them."""
        pressure = self.model.scene.pressures[names[0]]
        numbers = tuple(self.model.pressure_names.index(name) for name in names)
        chambers, points = [self.model.chambers[number] for number in numbers], self.model.structure.mesh.points
        return ShutChamber(
            numbers=numbers,
            triangles=np.concatenate([one.triangles for one in chambers]),
            sign=np.concatenate([one.sign for one in chambers]),
            rest_volume=sum(one.volume(points) for one in chambers),
            reference=pressure.ambient or 0.0,
            exponent=pressure.exponent,
            amount=0.0,
            ambient=pressure.ambient or 0.0,
            relief=float("inf") if pressure.relief is None else pressure.relief,
        )

    def press(self, state: LoadState) -> None:
        """Fill in a load state's amounts, less what relief valves have let out, and settle pressures and levels."""
        if self.contents is None:
            return
        self.contents.chambers = tuple(self.filled(state))
        self.contents.ponds = tuple(
            replace(pond, volume=state.values[f"load.{name}"]) for name, pond in self.waters.items()
        )
        self.contents.settle()

    def filled(self, state: LoadState) -> Iterator[ShutChamber]:
        """The shut chambers with a load state's amounts and pressures outside."""
        assert self.contents is not None
        for names, chamber in zip(self._gases, self.contents.chambers, strict=True):
            amount = sum(state.values[f"amount.{name}"] for name in names) - self.let_out.get(names[0], 0.0)
            yield replace(chamber, amount=amount, ambient=self.model.outside(state, names[0]))

    def begins(self, before: LoadState, after: LoadState) -> bool:
        """Whether a liquid of given volume is not there yet before a change, but after it."""
        drivers = [f"load.{name}" for name in self.waters]
        return any(before.values[one] == 0.0 and after.values[one] > 0.0 for one in drivers)

    def settled(self, state: LoadState) -> LoadState:
        """A load state with the pressures of shut chambers, and the amounts in all, as they now are."""
        values = {**state.values, **self._pressures(state, self.volumes())}
        alone = self._left(state)
        values |= alone
        asked = [
            name for name in self.model.pressure_names if f"amount.{name}" in values and f"amount.{name}" not in alone
        ]
        swept = self.system.swept_volumes(self.system.displacement()) if asked else np.zeros(0)
        for name in asked:
            pressure = self.model.scene.pressures[name]
            chamber = self.model.chambers[self.model.pressure_names.index(name)]
            volume = chamber.volume(self.model.structure.mesh.points) + float(chamber.sign @ swept[chamber.triangles])
            values[f"amount.{name}"] = amount_of(
                values[f"pressure.{name}"],
                volume,
                ambient=self.model.outside(state, name),
                reference=pressure.ambient or 0.0,
                exponent=pressure.exponent,
            )
        return LoadState(values)

    def volumes(self) -> list[float]:
        """Present volume of each gas in shut chambers."""
        return [] if self.contents is None else self.contents.volumes()

    def _pressures(self, state: LoadState, volumes: list[float]) -> dict[str, float]:
        """Pressures of shut chambers at some volumes with a load state's amounts, by driver."""
        if self.contents is None:
            return {}
        return {
            f"pressure.{self.model.pressure_names[number]}": chamber.pressure_at(volume)
            for chamber, volume in zip(self.filled(state), volumes, strict=True)
            for number in chamber.numbers
        }

    def _left(self, state: LoadState) -> dict[str, float]:
        """Amounts of gas in shut chambers that no tube joins, by driver."""
        if self.contents is None:
            return {}
        gases = zip(self._gases, self.filled(state), self.contents.volumes(), strict=True)
        return {f"amount.{names[0]}": one.left(volume) for names, one, volume in gases if len(names) == 1}

    def with_pressures(self, state: LoadState, volumes: list[float] | None = None) -> LoadState:
        """A load state with the pressures that shut chambers have in it.

        :param volumes: of each gas; the present ones when None.
        """
        if self.contents is None:
            return state
        return LoadState({**state.values, **self._pressures(state, self.volumes() if volumes is None else volumes)})

    def accept(self) -> dict[str, float]:
        """Take the present state for an equilibrium that lasts: what relief valves let out on the way to it is gone.

        :return: the amounts, by the first name of each gas that let some out.
        """
        if self.contents is None:
            return {}
        gone = {}
        for names, chamber, volume in zip(self._gases, self.contents.chambers, self.contents.volumes(), strict=True):
            lost = chamber.amount - chamber.left(volume)
            if lost > 0.0:
                gone[names[0]] = lost
                self.let_out[names[0]] = self.let_out.get(names[0], 0.0) + lost
        return gone

    def by_drivers(self, by_values: Mapping[str, Floats]) -> Iterator[tuple[str, Floats]]:
        """Derivatives of the forces by what stages give, from those by pressures and levels, by driver.

        A shut chamber's pressure is not given: its amount and the pressure outside are, and no other's. A relief valve that is open
        lets neither matter.
        """
        named = {} if self.contents is None else dict(zip(self._gases, self.contents.chambers, strict=True))
        shut = {name: (names, chamber) for names, chamber in named.items() for name in names}
        drivers = driver_names(self.model.scene)
        for driver, force in by_values.items():
            kind, _, name = driver.partition(".")
            if kind == "pressure" and name in shut:
                continue
            if name in self.waters and kind == "load":
                assert self.contents is not None
                pond = self.contents.ponds[list(self.waters).index(name)]
                displacement = self.system.displacement()
                area = pond.wet_area(pond.level(displacement), displacement)
                if area > 0.0:
                    yield driver, force / area
            else:
                yield driver, force
        if self.contents is None:
            return
        for (names, chamber), volume in zip(named.items(), self.contents.volumes(), strict=True):
            pushed = np.asarray(sum(by_values[f"pressure.{name}"] for name in names))
            for name in names:
                yield f"amount.{name}", chamber.by_amount(volume) * pushed
            if f"ambient.{names[0]}" in drivers:
                yield f"ambient.{names[0]}", (0.0 if chamber.is_open(volume) else -1.0) * pushed

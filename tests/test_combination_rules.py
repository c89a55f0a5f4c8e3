"""Combinations by a rule: one case leads, others go along, and what excludes each other never meets."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import taichi_membrane as tm
from taichi_membrane.errors import InputError
from taichi_membrane.scene import Combinations, Scene
from taichi_membrane.scene.file import with_overrides

CASES = {"snow": 1.5, "wind": 1.5, "back": 1.5}


def made(**rule: Any) -> dict[str, dict[str, float]]:
    return {case.name: case.combine for case in Combinations(name="uls", **rule).made()}


def test_each_leads_once_beside_what_goes_along() -> None:
    rule = {
        "always": {"weight": 1.35},
        "leading": {"snow": 1.5, "wind": 1.4},
        "accompanying": {"snow": 0.75, "wind": 0.9},
    }
    assert made(**rule) == {
        "uls_snow": {"weight": 1.35, "snow": 1.5, "wind": 0.9},
        "uls_wind": {"weight": 1.35, "wind": 1.4, "snow": 0.75},
    }


def test_what_excludes_each_other_goes_along_in_turn() -> None:
    rule = {"leading": CASES, "accompanying": {"snow": 0.75, "wind": 0.9, "back": 0.8}, "exclusive": [["wind", "back"]]}
    assert made(**rule) == {
        "uls_snow_wind": {"snow": 1.5, "wind": 0.9},
        "uls_snow_back": {"snow": 1.5, "back": 0.8},
        "uls_wind": {"wind": 1.5, "snow": 0.75},
        "uls_back": {"back": 1.5, "snow": 0.75},
    }


@given(st.lists(st.sets(st.sampled_from("abcdef"), min_size=2, max_size=3), max_size=4))
def test_every_set_of_companions_that_can_act_together_and_no_other(exclusive: list[set[str]]) -> None:
    """Against all subsets: none excludes another or the leader, and none could be added."""
    groups = [sorted(group) for group in exclusive]
    found = made(leading={"a": 1.0}, accompanying=dict.fromkeys("bcdef", 0.5), exclusive=groups)

    def fits(chosen: set[str]) -> bool:
        return not any(len(chosen & set(group)) > 1 for group in groups)

    subsets = [{"a", *some} for count in range(6) for some in combinations("bcdef", count)]
    able = [one for one in subsets if fits(one)]
    largest = [one for one in able if not any(one < other for other in able)]
    assert sorted(map(sorted, found.values())) == sorted(map(sorted, largest))
    assert len(found) == len(largest)  # each by a name of its own


def scene_with(**rule: Any) -> Scene:
    data = tm.load_scene("tent_cases").model_dump(exclude_unset=True)
    data["combinations"] = [{"name": "uls"} | rule]
    return with_overrides("here", data, [])


def test_a_scene_holds_the_cases_that_its_rules_make() -> None:
    scene = scene_with(leading={"lights": 1.35, "wind": 1.5}, accompanying={"lights": 1.0})
    assert [case.name for case in scene.cases][-2:] == ["uls_lights", "uls_wind"]
    assert scene.ramp("uls_wind").loads == {"wind": 1.5, "lights_1": 0.5, "lights_2": 0.5}
    assert Scene.model_validate(scene.model_dump()) == scene  # as a run stores it


@pytest.mark.parametrize(
    ("rule", "told"),
    [
        (
            {"leading": {"rain": 1.0}},
            "combinations.uls.leading: 'rain' is not a case that could be combined; allowed: lights, wind",
        ),
        (
            {"leading": {"wind": 1.0}, "accompanying": {"storm": 1.0}},
            "combinations.uls.accompanying: 'storm' is not a case",
        ),
        (
            {"leading": {"wind": 1.0}, "exclusive": [["wind", "hail"]]},
            "combinations.uls.exclusive: 'hail' is not a case",
        ),
        ({"leading": {"wind": 1.0}, "always": {"wind": 1.0}}, "combinations.uls.leading: 'wind' is in 'always' too"),
        ({"name": "u" * 58, "leading": {"wind": 1.0}}, "of more than 60 characters"),
        ({"leading": {}}, "leading"),
    ],
)
def test_what_is_wrong_is_told(rule: dict[str, Any], told: str) -> None:
    with pytest.raises(InputError, match="combinations") as error:
        scene_with(**rule)
    assert told in str(error.value)


def test_a_rule_that_makes_too_many_cases_ends_soon() -> None:
    """Twenty pairs that exclude each other would be a million combinations."""
    data = tm.load_scene("tent_cases").model_dump(exclude_unset=True)
    names = [f"case{number}" for number in range(41)]
    data["cases"] = [{"name": name, "loads": {"wind": 1.0}} for name in names]
    pairs = [names[k : k + 2] for k in range(1, 41, 2)]
    data["combinations"] = [
        {"name": "uls", "leading": {"case0": 1.0}, "accompanying": dict.fromkeys(names[1:], 0.5), "exclusive": pairs}
    ]
    with pytest.raises(InputError, match=r"combinations\.uls: a case would be called"):
        with_overrides("here", data, [])
    data["combinations"] = [
        {"name": f"r{k}", "leading": dict.fromkeys(names, 1.0 + k)} for k in range(25)
    ]  # each case alone, 25 times
    with pytest.raises(InputError, match=r"combinations\.r23: with its cases the scene has more than 1000"):
        with_overrides("here", data, [])


def test_a_case_that_is_there_already_is_not_made_again() -> None:
    with pytest.raises(InputError, match=r"cases\.lights_and_wind: another stage or case has the name already"):
        scene_with(name="lights_and", leading={"wind": 1.0})

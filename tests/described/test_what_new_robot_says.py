"""What `sealegs new-robot` says fits a screen."""

from __future__ import annotations

from sealegs.commands.new_robot import together


def test_what_is_said_of_many_joints_alike_is_one_sentence_with_the_range_of_its_numbers() -> None:
    """Of a public quadruped 36 lines were said, of three kinds."""
    said = [
        f"joint {name}: an ideal servo of {size} N.m/rad drives it (a1.urdf)."
        for name, size in zip("abc", (8, 9.5, 7e-5), strict=True)
    ]
    told = together([*said, "the floor is level.", "Warning: joint d: it is weak."])
    assert told == [
        "joints a, b, c: an ideal servo of 7e-05 to 9.5 N.m/rad drives it (a1.urdf).",
        "the floor is level.",
        "Warning: joint d: it is weak.",
    ]


def test_what_is_said_of_few_joints_stays_as_it_is() -> None:
    said = ["joint a: weak {so}.", "joint b: weak {so}.", "joint a: of 3 N.m.", "other."]
    assert together(said) == said


def test_names_and_signs_in_a_sentence_stay() -> None:
    said = [f"joint {k}: write {{joint: x, ...}} of 2 in 1.urdf." for k in (7, 8, 9)]
    assert together(said) == ["joints 7, 8, 9: write {joint: x, ...} of 2 in 1.urdf."]

"""Options: one list for command line, [dataset] table and record; strict about every value; shards."""

import argparse
import dataclasses
import math
from importlib import import_module
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.dataset.option_arguments import add_option_arguments, merged_options, option_arguments
from oneframe.dataset.options import (
    OPTIONS,
    SAMPLERS,
    DatasetOptions,
    Option,
    checked_options,
)
from oneframe.dataset.run.run_folder import Shard, parse_shard
from oneframe.dataset.truths import TRUTHS
from oneframe.errors import InputError
from oneframe.light.lens_light import LensLight

CASE = Path("folder/case.toml")


def merged(table: dict, *argv: str, light: LensLight | None = None) -> DatasetOptions:
    parser = argparse.ArgumentParser(exit_on_error=False)
    add_option_arguments(parser)
    return merged_options(table, vars(parser.parse_args(argv)), CASE, light=light)


def test_command_line_goes_before_the_table_and_that_before_the_defaults():
    options = merged({"count": 7, "cone_deg": 30, "float_depth": True}, "--count", "9", "--sampler", "shell")
    assert options == DatasetOptions(count=9, cone_deg=30.0, float_depth=True, sampler="shell")
    assert merged({"video": True}, "--no-video").video is False
    # also where the table alone is in conflict with a default
    assert merged({"distance_min": 1.2}, "--distance-max", "1.3").distance_max == 1.3


def test_for_training_gives_way_to_what_is_said_beside_it():
    assert {truth.option for truth in TRUTHS.values()} <= {"", *OPTIONS}
    training = DatasetOptions(unseen="fill", highlights="drop", surroundings="frame", max_incidence_deg=80.0)
    assert merged({"unseen": "neutral"}, "--for-training") == training
    lamp, spot = LensLight((0, 0, 0), 0.1), LensLight(None, 1.0, vignetting=2.0)
    for light, engine, expected in ((lamp, "raster", "shadows"), (lamp, "eevee", "lens"), (spot, "raster", "lens")):
        options = merged({"engine": engine}, "--for-training", light=light)
        assert options == dataclasses.replace(training, engine=engine, light=expected)
    but = "--unseen", "neutral", "--highlights", "keep", "--surroundings", "none", "--max-incidence-deg", "87"
    assert merged({}, *but, "--light", "lens", "--for-training", light=lamp) == DatasetOptions(light="lens")


def legal_and_not(entry: Option) -> tuple[list[object], list[object]]:
    """Values of an option at the ends of what it takes, and just beyond them."""
    kind = entry.kind
    if kind is bool:
        return [True, False], [1, "true"]
    if kind not in (int, float):
        return list(entry.choices) or ["poses.npy"], [1, ""] if entry.choices else [1]
    ends = [float(end) for end in (entry.least, entry.most) if math.isfinite(end)]
    beyond = [entry.least - 1, *([entry.most + 1] if math.isfinite(entry.most) else [])]
    return [kind(end) for end in ends], [*beyond, float("nan"), True, "1"]


@pytest.mark.parametrize("entry", OPTIONS.values(), ids=lambda entry: entry.key)
def test_an_option_takes_its_limits_and_nothing_beyond_by_flag_and_table(entry):
    legal, illegal = legal_and_not(entry)
    # an order that the ends of one alone would break, and what one needs
    needed = {
        "distance_min": {"distance_max": 1000},
        "distance_max": {"distance_min": 0.01},
        "eye": {"stereo_mm": 24},
    }
    other = needed.get(entry.key, {})
    for value in legal:
        options = checked_options({**other, entry.key: value}, "table")
        assert getattr(options, entry.key) == value
        assert merged({}, *option_arguments(options)) == options
    for value in illegal:
        with pytest.raises(InputError, match=f"table: {entry.key}: expected"):
            checked_options({entry.key: value}, "table")


def test_a_sampler_is_a_class_that_takes_its_options_and_the_docs_list_it():
    docs = Path("docs/rendering-many.md").read_text(encoding="utf-8")
    for name, sampler in SAMPLERS.items():
        module, kind = sampler.place.split(":")
        fields = {field.name for field in dataclasses.fields(getattr(import_module(f"oneframe.poses.{module}"), kind))}
        assert fields >= set(sampler.options)
        flags = ", ".join(f"`{OPTIONS[option].flag}`" for option in sampler.options)
        shown = f"`{name}`" + " (default)" * (name == DatasetOptions().sampler)
        assert f"| {shown} | {sampler.about} | {flags} |" in docs


def test_poses_are_relative_to_the_case_in_its_table_but_not_in_a_command():
    assert merged({"poses": "poses.npy"}).poses == str(Path("folder/poses.npy"))
    assert merged({"poses": "poses.npy"}, "--poses", "other.npy").poses == "other.npy"


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"count": 0}, "count: expected 1 to 1e\\+07, found 0"),
        ({"conut": 7}, "unknown option 'conut'; did you mean 'count'\\?"),
        ({"engine": "cycle"}, "found 'cycle'; did you mean 'cycles'\\?"),
        ({"distance_min": 1.2}, "expected distance_min <= distance_max, found 1.2 > 1.1; swap them"),
        ({"converge_mm": 300}, "expected converge_mm of at least stereo_mm, and that above 0, found 300 and 0 mm"),
    ],
    ids=str,
)
def test_bad_values_are_refused_and_named(values, message):
    with pytest.raises(InputError, match=message):
        checked_options(values, "case.toml: [dataset]")
    # a table's mistake is told with the table's name, whatever the command line says
    with pytest.raises(InputError, match=message):
        merged(values, "--roll-deg", "3")


@given(total=st.integers(1, 20_000), count=st.integers(1, 40), per_scene=st.sampled_from([1, 7, 1000]))
def test_shards_part_the_views(total, count, per_scene):
    shards = [Shard(index, count).views(total, per_scene) for index in range(count)]
    assert [view for shard in shards for view in shard] == list(range(total))
    if total >= per_scene * count:
        # whole scenes, so that each shard can write the tables of its own
        assert all(shard.start % per_scene == 0 for shard in shards)
        unit = per_scene
    else:
        unit = 1
    sizes = [len(shard) for shard in shards]
    assert max(sizes) - min(sizes) <= 2 * unit - (unit == 1)


def test_a_shard_is_one_of_several():
    assert parse_shard("3/50") == Shard(3, 50)
    for text in ("1", "4/4", "-1/4", "a/b"):
        with pytest.raises(InputError, match="--shard: expected I/N"):
            parse_shard(text)

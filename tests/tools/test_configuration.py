"""The configuration as the tools see it: what hpmc_config resolved and checked."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from hpmc.configuration import ConfigurationError, experiments, load_configuration
from hpmc.layout import CONFIG, PROGRAMS


def test_experiments_are_the_files_of_the_folder() -> None:
    assert experiments() == ["clock", "figure_of_eight", "wall"]


def test_values_are_those_of_the_file() -> None:
    configuration = load_configuration("clock")
    assert configuration.values == tomllib.loads((CONFIG / "clock.toml").read_text())
    assert tomllib.loads(configuration.toml) == configuration.values
    assert (configuration.repetitions, configuration.seed) == (1, 1)


def test_other_experiments_say_what_differs_from_the_clock() -> None:
    clock = load_configuration("clock").values
    for name in experiments():
        own = tomllib.loads((CONFIG / f"{name}.toml").read_text())
        expected = {section: keys | own.get(section, {}) for section, keys in clock.items()}
        assert load_configuration(name).values == expected


def test_an_unknown_experiment_is_said_so() -> None:
    with pytest.raises(ConfigurationError, match=r"no experiment 'watch' .choose from clock, "):
        load_configuration("watch")


def test_derived_facts() -> None:
    usual = load_configuration("clock")
    assert (usual.periods_per_repetition, usual.joint_ticks) == (17250, 1)
    assert usual.bus_load_worst_percent == pytest.approx(87.5)
    other = load_configuration("clock", overrides=["joint.rate_Hz=5000", "experiment.period_s=0.3"])
    assert (other.periods_per_repetition, other.joint_ticks) == (1000 + 16 * 300 + 250, 5)
    injected = load_configuration("clock", overrides=["rig.sensors=injected"])
    assert injected.bus_load_worst_percent == pytest.approx(128.0)


def test_files_go_over_the_experiment_and_overrides_over_files(tmp_path: Path) -> None:
    first, second = tmp_path / "first.toml", tmp_path / "second.toml"
    first.write_text("[experiment]\nseed = 5\nrepetitions = 3\n")
    second.write_text("[experiment]\nseed = 6\n")
    assert load_configuration("clock", [first, second]).seed == 6
    assert load_configuration("clock", [second, first]).seed == 5
    both = load_configuration("clock", [first], ["experiment.seed=9", "experiment.seed=10"])
    assert (both.seed, both.repetitions) == (10, 3)


def test_a_comma_or_a_quotation_mark_in_an_override_is_kept() -> None:
    moved = load_configuration("clock", overrides=["experiment.centre_m=[0.29, 0.01]"])
    assert moved.values["experiment"]["centre_m"] == [0.29, 0.01]
    rule = load_configuration("clock", overrides=['joint.phase_rule="error_growth"'])
    assert rule.values["joint"]["phase_rule"] == "error_growth"


def test_what_is_wrong_comes_in_one_line(tmp_path: Path) -> None:
    broken = tmp_path / "broken.toml"
    broken.write_text("[experiment\n")
    for files, overrides, words in (
        ([], ["experiment.seed=-1"], "experiment.seed: must be a whole number, 0 to 2147483647"),
        ([tmp_path / "none.toml"], [], "none.toml: no such file"),
        ([broken], [], "broken.toml, line 1: "),
    ):
        with pytest.raises(ConfigurationError) as raised:
            load_configuration("clock", files, overrides)
        assert words in str(raised.value) and "\n" not in str(raised.value)


def test_all_programs_are_where_they_are_looked_for() -> None:
    assert [name for name, path in PROGRAMS.items() if not path.is_file()] == []

"""An amplifier whose control signal is a current: its gain is given in A/A."""

import zipfile

import numpy as np
import pytest
from exporting import export_c, export_fmu

import ambkit
from ambkit.base.errors import ConfigError
from ambkit.campaigns.keys import changed

VOLTS = ambkit.preset("zittau_axial").replace(amplifier__gain="2 A/V")


def in_amperes(folder, gain):
    path = folder / "b.toml"
    VOLTS.save(path)
    text = path.read_text(encoding="utf-8")
    assert text.count("2 A/V") == 1
    lines = [
        line.replace("V^2", "A^2") if line.startswith("noise_variance") else line
        for line in text.replace("2 A/V", gain).splitlines()
    ]
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


@pytest.mark.parametrize("gain", ["2 A/A", "2000 mA/A", "2"])
def test_its_number_counts_as_one_in_amperes_per_volt(tmp_path, gain):
    read = ambkit.Machine.load(in_amperes(tmp_path, gain))
    assert "A^2" in (tmp_path / "b.toml").read_text(encoding="utf-8")
    assert read.amplifier == VOLTS.amplifier
    runs = [ambkit.simulate(b, step="0.1 mm", duration=0.02, seed=1).record for b in (read, VOLTS)]
    assert np.array_equal(runs[0]["u"], runs[1]["u"])


@pytest.mark.parametrize("gain", ["2 V/A", "2 N/A", "2 A"])
def test_a_gain_of_another_kind_is_refused(tmp_path, gain):
    with pytest.raises(ConfigError, match=r"amplifier\.gain.*A/V"):
        ambkit.Machine.load(in_amperes(tmp_path, gain))


def test_exports_name_its_unit(tmp_path):
    read = ambkit.Machine.load(in_amperes(tmp_path, "2 A/A"))
    export_c(read, None, tmp_path / "c")
    header = (tmp_path / "c" / "zittau_axial.h").read_text(encoding="utf-8")
    assert "u[k - 1] [A]" in header
    assert "control signal: 8e-05 A^2" in header
    export_fmu(read, None, tmp_path / "a.fmu")
    xml = zipfile.ZipFile(tmp_path / "a.fmu").read("modelDescription.xml").decode()
    assert 'unit="A2"' in xml
    assert 'unit="V' not in xml


def test_a_study_that_varies_its_gain_keeps_its_unit(tmp_path):
    read = ambkit.Machine.load(in_amperes(tmp_path, "2 A/A"))
    varied = changed(read, {"amplifier": {"gain": 2.1}})
    assert varied.amplifier.gain == 2.1
    assert varied.amplifier.control_unit == "A"
    assert 'gain = "2.1 A/A"' in varied.to_toml()


def test_a_filters_file_names_its_unit(tmp_path):
    """Also where the bearing is a preset but for that: it is no preset then."""
    read = ambkit.Machine.load(in_amperes(tmp_path, "2 A/A"))
    usual = ambkit.preset("zittau_axial")
    as_usual = read.replace(amplifier__gain="1 A/A")
    assert as_usual == usual
    noise = ambkit.FilterNoise(control="100 mA^2")
    for name, bearing in (("a", read), ("b", as_usual)):
        ambkit.ExtendedKalmanFilter(bearing, noise=noise).save(tmp_path / f"{name}.toml")
        text = (tmp_path / f"{name}.toml").read_text(encoding="utf-8")
        assert 'control = "100 mA^2"' in text
        assert '[inputs.u]\nunit = "A"' in text
        again = ambkit.Estimator.load(tmp_path / f"{name}.toml")
        assert again.machine.control_unit == again.inputs.u.unit == "A"
        assert again.variances.control == 1e-4
    with pytest.raises(ValueError, match=r"noise\.control is in A\^2; the control signal is in V"):
        ambkit.ExtendedKalmanFilter(usual, noise=noise)

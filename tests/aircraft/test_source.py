"""JSBSim models of other people, read in one piece."""

import xml.etree.ElementTree as ET

import pytest

from testbench.aircraft.source import find_model, read_source
from testbench.core.errors import ModelError
from testbench.core.paths import is_jsbsim_model, stock_names, stock_root

HEAD = '<?xml version="1.0"?>\n<fdm_config name="x" version="2.0">\n'


def stock(name):
    return read_source(find_model(stock_root() / "aircraft" / name))


def test_sixty_models_come_with_jsbsim_and_all_but_one_can_be_read():
    refused = []
    for name in stock_names():
        try:
            source = stock(name)
        except ModelError as error:
            refused.append((name, error.message))
            continue
        assert ET.fromstring(source.xml).tag == "fdm_config"
        assert 'file="' not in source.xml.replace('engine file="', "").replace('thruster file="', "")
    assert len(stock_names()) == 60
    assert [name for name, _ in refused] == ["blank"]  # an old form of the format, in capitals
    assert "FDM_CONFIG" in refused[0][1]


def test_includes_are_put_in_where_they_stood_and_named():
    source = stock("DHC6")
    assert source.included == ("Propulsion.xml", "Conventional Controls.xml", "Landing Gear.xml", "Flaps.xml")
    tree = ET.fromstring(source.xml)
    assert len(tree.findall("system")) == 4
    assert all(len(system) for system in tree.findall("system"))
    assert set(source.engine_files) == {"PT6A-27.xml", "Propeller.xml"}


def test_entities_that_say_one_word_are_read():
    assert "GNCUtilities.xml" in stock("c172x").included


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ('<system file="helper"/></fdm_config>', "the <system> file 'helper'"),
        ('<aerodynamics file="aero.xml"/></fdm_config>', "the <aerodynamics> file 'aero.xml'"),
        ('<propulsion><engine file="merlin"/></propulsion></fdm_config>', "the engine file 'merlin'"),
        ("<metrics></fdm_config>", "mismatched tag: line 3, column"),
        ("", "no element found: line 3"),
    ],
)
def test_what_is_missing_or_damaged_is_named(tmp_path, body, words):
    file = tmp_path / "x.xml"
    file.write_text(HEAD + body, encoding="utf-8")
    with pytest.raises(ModelError, match=words) as caught:
        read_source(file)
    assert "x.xml" in caught.value.message


def test_an_included_engine_that_is_damaged_is_named(tmp_path):
    (tmp_path / "merlin.xml").write_text("<piston_engine>", encoding="utf-8")
    file = tmp_path / "x.xml"
    file.write_text(HEAD + '<propulsion><engine file="merlin"/></propulsion></fdm_config>', encoding="utf-8")
    with pytest.raises(ModelError, match=r"merlin.xml' must be a JSBSim file in XML"):
        read_source(file)


def test_entities_that_multiply_are_refused_before_they_unfold(tmp_path):
    levels = "".join(f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip("abcdefgh", "bcdefghi", strict=True))
    file = tmp_path / "x.xml"
    file.write_text(
        f'<?xml version="1.0"?><!DOCTYPE l [<!ENTITY a "aaaaaaaaaa">{levels}]><fdm_config>&i;</fdm_config>',
        encoding="utf-8",
    )
    with pytest.raises(ModelError, match="entities of a JSBSim file in XML must be short texts"):
        read_source(file)


def test_a_folder_with_two_models_must_say_which(tmp_path):
    for name in ("one", "two"):
        (tmp_path / f"{name}.xml").write_text(HEAD + "</fdm_config>", encoding="utf-8")
    with pytest.raises(ModelError, match=r"got one.xml, two.xml; name the file"):
        find_model(tmp_path)
    assert find_model(tmp_path / "two.xml") == tmp_path / "two.xml"


def test_what_is_no_model_is_not_taken_for_one(tmp_path):
    (tmp_path / "page.xml").write_text("<html/>", encoding="utf-8")
    assert not is_jsbsim_model(tmp_path)
    assert not is_jsbsim_model(tmp_path / "page.xml")
    assert not is_jsbsim_model(tmp_path / "nothing")
    assert find_model(tmp_path) is None

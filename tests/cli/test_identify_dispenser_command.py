"""The command `gantrysim identify dispenser`, beside that for axes."""

import tomllib

import pytest

FIVE = "pressure [kPa];time [s];mass [mg]\n100;60;33,2\n200;30;52,5\n300;20;68,3\n400;15;84,1\n500;10;80,2\n"
GLUE = ("--density", "1.2", "--needle", "22Gx12.7")


def test_tables_are_written_once_they_are_identified(gantrysim_command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data.csv").write_text(FIVE, encoding="utf-8")
    status, output, said = gantrysim_command("identify", "dispenser", "data.csv", *GLUE)
    assert (status, said) == (0, "")
    for words in ("flow index", "measure next: ", "written to dispenser.toml", "[dispenser.needle]"):
        assert words in output
    text = (tmp_path / "dispenser.toml").read_text(encoding="utf-8")
    table = tomllib.loads(text)["dispenser"]
    assert (table["kind"], table["metering"]) == ("valve", "time-pressure")
    assert (table["needle"]["bore"], table["needle"]["length"]) == (0.413, 12.7)
    assert "# needle.index = " in text
    # it replaces its own file, and no other
    assert gantrysim_command("identify", "dispenser", "data.csv", *GLUE)[0] == 0
    (tmp_path / "mine.toml").write_text("mine = 1\n", encoding="utf-8")
    status, _, said = gantrysim_command("identify", "dispenser", "data.csv", *GLUE, "--out", "mine.toml")
    assert (status, "--out mine.toml: holds something else" in said) == (2, True)
    assert (tmp_path / "mine.toml").read_text(encoding="utf-8") == "mine = 1\n"


def test_other_headings_are_named(gantrysim_command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = FIVE.replace("mass [mg]", "Waage").replace("pressure [kPa]", "Druck [kPa]")
    (tmp_path / "data.csv").write_text(text, encoding="utf-8")
    status, _, said = gantrysim_command("identify", "dispenser", "data.csv", *GLUE)
    assert (status, "has no column mass, width, height or flow; it has: Druck, time, Waage" in said) == (2, True)
    named = ("--column", "mass=Waage [mg]", "--column", "pressure=Druck")
    assert gantrysim_command("identify", "dispenser", "data.csv", *GLUE, *named)[0] == 0


@pytest.mark.parametrize(
    ("text", "arguments", "sentence"),
    [
        (FIVE, ("--needle", "22Gx12.7"), "the density of the glue is missing"),
        (FIVE.replace("500;10", "500;-10"), GLUE, "time = -10 in row 5: must be greater than 0"),
    ],
)
def test_spoiled_data_write_nothing(gantrysim_command, tmp_path, monkeypatch, text, arguments, sentence):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data.csv").write_text(text, encoding="utf-8")
    status, _, said = gantrysim_command("identify", "dispenser", "data.csv", *arguments)
    assert (status, said.startswith("not identified: "), sentence in said) == (1, True, True)
    assert not (tmp_path / "dispenser.toml").exists()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((), "a log of axes that is named dispenser is read as ./dispenser"),
        (("data.csv", "--needle", "22G"), "--needle 22G: must be BORExLENGTH in mm"),
        (("data.csv", "--needle", "99Gx12"), "unknown gauge of the needle '99G'"),
        (("data.csv", "--density", "-1"), "density = -1 g/cm³: must be greater than 0"),
        (("data.csv", "--column", "mas=time"), "unknown column 'mas'"),
        (("none.csv",), "none.csv: cannot be read"),
        (("bare.csv",), "column mass has no unit: must be one of mg, g,"),
        (("part.csv",), "weighing: mass is empty in some of its rows"),
    ],
)
def test_bad_input_is_a_one_line_error(gantrysim_command, tmp_path, monkeypatch, arguments, sentence):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data.csv").write_text(FIVE, encoding="utf-8")
    (tmp_path / "bare.csv").write_text("time [s],mass\n1,2\n2,4\n3,6\n4,8\n", encoding="utf-8")
    (tmp_path / "part.csv").write_text("time [s],mass [mg]\n1,2\n2,\n3,6\n4,8\n", encoding="utf-8")
    status, output, said = gantrysim_command("identify", "dispenser", *arguments)
    assert (status, output, said.count("\n")) == (2, "", 1)
    assert sentence in said


def test_both_commands_are_shown_and_a_log_needs_no_name(gantrysim_command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, output, _ = gantrysim_command("identify", "--help")
    assert (status, "axes" in output, "dispenser" in output) == (0, True, True)
    for log in ("./dispenser", "./axes", "log.csv"):
        status, _, said = gantrysim_command("identify", log, "--machine", "xy")
        assert (status, f"log {log.removeprefix('./')}: cannot be read" in said) == (2, True)

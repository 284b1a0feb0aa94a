"""What is done when a module is imported."""

import importlib
import sys

import pytest

from gantrysim.base.import_hooks import when_imported

NAME = "imported_later"


@pytest.fixture
def module(tmp_path, monkeypatch):
    """A module that can be imported, and is forgotten again."""
    (tmp_path / f"{NAME}.py").write_text("value = 7\n")
    monkeypatch.syspath_prepend(tmp_path)
    finders = list(sys.meta_path)
    yield NAME
    sys.modules.pop(NAME, None)
    sys.meta_path[:] = finders


def test_the_function_is_called_once_after_the_import(module):
    values = []
    when_imported(module, lambda imported: values.append(imported.value))
    assert values == []
    imported = importlib.import_module(module)
    assert values == [7]
    importlib.reload(imported)
    assert values == [7]


def test_the_function_is_called_at_once_where_the_module_is_there(module):
    imported = importlib.import_module(module)
    modules = []
    when_imported(module, modules.append)
    assert modules == [imported]


def test_the_module_is_as_without_a_function(module):
    expected = importlib.import_module(module)
    del sys.modules[module]
    when_imported(module, lambda imported: None)
    imported = importlib.import_module(module)
    assert type(imported.__loader__) is type(expected.__loader__)
    assert type(imported.__spec__.loader) is type(expected.__spec__.loader)
    assert imported.__loader__.get_source(module) == "value = 7\n"


def test_functions_of_one_module_are_all_called(module):
    calls = []
    for number in range(3):
        when_imported(module, lambda imported, number=number: calls.append(number))
    importlib.import_module(module)
    assert sorted(calls) == [0, 1, 2]


def test_a_module_that_does_not_exist_is_not_found(module):
    calls = []
    when_imported("no_such_module_at_all", calls.append)
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("no_such_module_at_all")
    assert calls == []

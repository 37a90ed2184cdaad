"""The runner of pages: what it must notice in a page, and what it must leave behind."""

import subprocess
from pathlib import Path

import pytest
from page_runner import elsewhere
from page_runner.blocks import named_file
from page_runner.collector import PageSybil
from page_runner.command_lines import split_commands
from page_runner.evaluation import page_fixtures, set_up, tear_down

CI = (Path(__file__).parents[2] / ".ci" / "run").read_text(encoding="utf-8")


@pytest.fixture
def run_page(tmp_path):
    """A function that runs a page, given as text in which ''' stands for a fence."""

    def run(text):
        file = tmp_path / "page.md"
        file.write_text(text.replace("'''", "```"), encoding="utf-8")
        sybil = PageSybil(tmp_path)
        document = sybil.parse(file)
        set_up(document.namespace)
        try:
            for example in document:
                example.evaluate()
        finally:
            tear_down(document.namespace)
        return document.namespace

    return run


def test_blocks_share_a_namespace_and_output_is_compared(run_page):
    page = "'''python\nvalue = 2 / 3\n'''\n\nThen:\n\n'''python\nprint(value)\n'''\n\n'''text\n{}\n'''\n"
    assert run_page(page.format("0.66..."))["value"] == 2 / 3
    with pytest.raises(AssertionError, match="the output is not that of the page"):
        run_page(page.format("0.67..."))


def test_output_of_commands_is_compared(run_page):
    page = "'''bash\necho one\npython -c \"\nprint('two')\"  # two\n'''\n'''text\none\n{}\n'''\n"
    run_page(page.format("two"))
    with pytest.raises(AssertionError, match="the output is not that of the page"):
        run_page(page.format("three"))


def test_page_with_a_failing_command_fails(run_page):
    with pytest.raises(AssertionError, match="ended with status 2"):
        run_page("'''bash\nrobot-dynamics no_such_verb\n'''\n")


def test_page_with_an_exception_fails(run_page):
    with pytest.raises(ZeroDivisionError):
        run_page("'''python\n1 / 0\n'''\n")


@pytest.mark.parametrize(
    "command",
    ["curl example.org", "ros2 run nav2 planner", "ros2 topic bw /x", "make no_such_target", "ros2 launch nav2 a.py"],
)
def test_page_with_an_unknown_command_fails(run_page, command):
    with pytest.raises(AssertionError, match=r"know|cannot run|no target|no launch files"):
        run_page(f"'''bash\n{command}\n'''\n")


def test_named_blocks_become_files(run_page):
    page = "'''yaml\n# folder/arm.yaml\nlinks: 3\n'''\n'''python\n# show.py\nprint('shown')\n'''\n"
    run_page(
        page + "'''bash\npython show.py\ncat folder/arm.yaml\n'''\n'''text\nshown\n# folder/arm.yaml\nlinks: 3\n'''\n"
    )


@pytest.mark.parametrize(
    ("line", "name"),
    [
        ("# arm.yaml", "arm.yaml"),
        ("<!-- arm.urdf -->", "arm.urdf"),
        ("// main.c", "main.c"),
        ("# .github/workflows/check.yml", ".github/workflows/check.yml"),
        ("# Makefile", "Makefile"),
        ("# the arm.yaml of before", None),
        ("# before", None),
        ("# ../arm.yaml", None),
        ("arm.yaml", None),
    ],
)
def test_first_line_with_only_a_file_name_names_a_file(line, name):
    assert named_file(f"{line}\ncontent\n") == name


def test_text_without_a_block_before_it_fails(run_page):
    with pytest.raises(AssertionError, match="is an output"):
        run_page("'''python\nprint(1)\n'''\nprints\n'''text\n1\n'''\n")


@pytest.mark.parametrize("language", ["py", "sh", "console", "{code-block} python"])
def test_languages_that_would_not_be_run_fail(run_page, language):
    with pytest.raises(AssertionError, match="in the place of"):
        run_page(f"'''{language}\nprint(1)\n'''\n")


def test_markdown_that_is_shown_is_not_run(run_page):
    run_page("~~~~markdown\n'''python\n1 / 0\n'''\n~~~~\n")


def test_blocks_in_directives_are_run(run_page):
    with pytest.raises(ZeroDivisionError):
        run_page("~~~~{tip}\n'''python\n1 / 0\n'''\n~~~~\n")


def test_skip_needs_a_reason(run_page):
    with pytest.raises(AssertionError, match="the reason"):
        run_page("% skip: next\n\n'''python\n1 / 0\n'''\n")


def test_set_up_makes_files_and_must_exist(run_page, monkeypatch):
    assert {"run", "run_loaded"} <= set(vars(page_fixtures()))
    with pytest.raises(AssertionError, match="no function no_such"):
        run_page("% setup: no_such\n")


@pytest.mark.ros
def test_nodes_run_until_the_page_ends(run_page):
    page = (
        "'''bash\ndynamics_server --ros-args -p robot_file:=rx90 -r __ns:=/pages\n'''\n"
        "'''bash\nros2 param set /pages/dynamics_server payload.mass 1.5\n"
        "ros2 param get /pages/dynamics_server payload.mass\n'''\n"
        "'''text\nSet parameter successful\nDouble value is: 1.5\n'''\n"
    )
    run_page(page)
    assert not subprocess.run(["pgrep", "-f", "__ns:=/[p]ages"], capture_output=True, check=False).stdout
    with pytest.raises(AssertionError, match=r"Setting parameter failed: parameter gravity"):
        run_page(page + "'''bash\nros2 param set /pages/dynamics_server gravity [1.0]\n'''\n")


@pytest.mark.ros
def test_node_that_cannot_start_fails(run_page):
    with pytest.raises(AssertionError, match="ended with status 1"):
        run_page("'''bash\ncomputed_torque --ros-args -p kp:=[-5.0]\n'''\n")


def test_commands_go_on_over_lines():
    block = (
        '# a comment: don\'t\nros2 service call /a "\nb: 1"\n\ncc -o main \\\n  main.c  # end\ncat <<END\ntext\nEND\n'
    )
    assert split_commands(block) == [
        'ros2 service call /a "\nb: 1"',
        "cc -o main \\\n  main.c  # end",
        "cat <<END\ntext\nEND",
    ]


def test_parts_of_the_ci_run_what_pages_do_not():
    for entry in elsewhere.ELSEWHERE:
        assert bool(entry.part) != bool(entry.reason), entry
        assert not entry.part or f'part "{entry.part}"' in CI, entry

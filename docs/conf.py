"""Settings of Sphinx for this documentation: `make docs` builds it."""

from __future__ import annotations

import sys
from pathlib import Path

DOCS = Path(__file__).parent
sys.path[:0] = [str(DOCS.parent), str(DOCS / "extensions")]  # the checkout, and the extensions beside this file

from robot_dynamics.version import package_version  # noqa: E402

project = "robot_dynamics"
author = "the authors of robot_dynamics"
project_copyright = author
version = release = package_version()

extensions = [
    "myst_nb",  # pages in Markdown, tutorials as notebooks
    "sphinx.ext.autodoc",
    "numpydoc",  # docstrings are in NumPy form
    "sphinx_copybutton",
    "sphinx_design",  # the cards of the front page
    "api_names",
    "mathml",
    "reference_pages",
]
smartquotes = False
exclude_patterns = ["extensions"]
nitpicky = True
nitpick_ignore = [
    # types of other packages: a build without a network cannot link to their documentation
    *(("py:class", name) for name in ("Path", "pathlib.Path", "Context", "rclpy.context.Context")),
    *(("py:class", name) for name in ("Node", "rclpy.node.Node")),
    *(("py:class", f"collections.abc.{name}") for name in ("Callable", "Iterable", "Mapping", "Sequence")),
    ("py:class", "concurrent.futures._base.Executor"),
    ("py:class", "rcl_interfaces.msg._set_parameters_result.SetParametersResult"),
    # types that a user neither makes nor takes apart
    *(("py:class", name) for name in ("ConstrainedState", "Flexibility", "JointDynamics", "Loop", "LoopCoordinates")),
    ("py:class", "robot_dynamics.viewing.played_motion.PlayedMotion"),
    ("py:class", "PlayedMotion"),
    *(
        ("py:class", name)
        for name in ("Platform", "ProgramResult", "robot_dynamics.flexible.elastodynamics.RobotGeometry")
    ),
    ("py:class", "robot_dynamics.parallel.platform_dynamics.Platforms"),
]
suppress_warnings = ["config.cache"]

# Markdown
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

# Notebooks: tutorials are run at each build. A cell that fails ends the build.
nb_execution_mode = "force"
nb_execution_excludepatterns = ["explanation/*", "how_to/*", "reference/*"]
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_execution_in_temp = True  # they write files
nb_merge_streams = True

# Reference of the library
toc_object_entries_show_parents = "hide"
default_role = "py:known"  # `inverse` in a docstring links where such a name is documented (extensions/api_names.py)
add_module_names = False
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
python_maximum_signature_line_length = 88
numpydoc_show_class_members = False
numpydoc_show_inherited_class_members = False
numpydoc_class_members_toctree = False
copybutton_exclude = ".linenos, .gp, .go"

# Formulas are MathML, which browsers draw by themselves: nothing is loaded from a network.
html_math_renderer = "mathml"
html_theme = "furo"
html_title = f"robot_dynamics {version}"
html_copy_source = False
html_show_sphinx = False
html_static_path = ["extensions/static"]
html_css_files = ["reference.css"]
html_theme_options = {"navigation_with_keys": True}
autodoc_type_aliases = {
    name: name
    for name in ("Array", "ArrayLike", "BoolArray", "ExternalWrenches", "PlatformArray", "PlatformInput", "ScalarArray")
}

"""Sphinx: MyST Markdown, the Furo theme, docstrings in NumPy style. Warnings are errors."""

import sys
from pathlib import Path

import ftforce

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

project = "ftforce"
author = "The ftforce developers"
project_copyright = author
version = release = ftforce.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "docstrings",  # small repairs between NumPy docstrings and autodoc
    "mathml",  # formulas without a network and without JavaScript
    "from_code",  # tables of options, JSON keys and CSV columns, made from the program
]
exclude_patterns = ["_build", "examples", "pictures"]
nitpicky = True

# Markdown
myst_enable_extensions = ["deflist", "dollarmath", "fieldlist"]
myst_heading_anchors = 3
math_numfig = False

# Docstrings
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_class_signature = "mixed"
autodoc_preserve_defaults = True
napoleon_google_docstring = False
napoleon_custom_sections = [("Attributes", "params_style")]  # takes "lower, upper :" in one entry
napoleon_use_rtype = False
python_use_unqualified_type_names = True
python_display_short_literal_types = True
default_role = "py:obj"
# Names that are no targets here: other libraries' types, which are not linked because a build needs
# no network; annotations of the standard library; literals; type aliases and private classes.
nitpick_ignore_regex = [
    (r"py:.*", r"(numpy|np|pin|pinocchio|rich|collections|os|pathlib|typing|enum|threading)\..*"),
    (r"py:.*", r"Any|ArrayLike|Callable|Iterable|Iterator|Mapping|Path|PathLike|Sequence"),
    (r"py:.*", r"Element|XmlFile|RenderableType|StrEnum|Protocol|NamedTuple|NDArray|ndarray"),
    (r"py:.*", r"'.*'"),
    (r"py:.*", r"Vector|Matrix|Mask|Axes|Convention|JointType|Solid|Document|Row|Indices"),
    (
        r"py:.*",
        r"Joints|WeakJoints|LimitsLike|FrictionLike|PayloadLike|Inverse|RankBy|CapabilityRange\.direction",
    ),
    (r"py:.*", r"Stack|RangesLike|LocksLike|ftforce\.io\.xml_text\.XmlFile"),
    (r"py:.*", r"Shown|Drawable|Keep|Counts|Arm|Result|Whole|Codes|Values|xr\..*|xarray\..*"),
    (r"py:.*", r"Trajectory|Smooth|Events|Law|Tick|Kind|Quantity|Torque|Figure|Problem"),
    (r"py:.*", r"(scipy|matplotlib)\..*"),
]

# HTML
html_theme = "furo"
html_title = "ftforce"
html_static_path = ["_static"]
html_css_files = ["ftforce.css"]
html_math_renderer = "mathml"
html_copy_source = False
html_show_sourcelink = False

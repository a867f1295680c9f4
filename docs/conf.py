"""The documentation as a site: `make docs`. The pages are this folder's Markdown and read as well where they lie."""

from __future__ import annotations

import sys
from pathlib import Path

import vbaa_calib

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "vbaa-calib"
author = "the vbaa-calib authors"
copyright = "the vbaa-calib authors, Apache-2.0"
version = release = vbaa_calib.__version__
language = "en"
smartquotes = False  # -- is an option's beginning here, and no dash

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    # of this folder
    "beside",
    "docstrings",
    "offline_search",
    "verb_reference",
]
exclude_patterns = ["_build", "_ext"]
source_suffix = {".md": "markdown"}
root_doc = "index"

myst_heading_anchors = 4

default_role = "literal"
add_module_names = False
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 100
napoleon_google_docstring = False
napoleon_use_ivar = True
# Their documentation lies on other hosts, and a build asks no other host. What is ours has to resolve.
nitpick_ignore_regex = [
    (r"py:.*", r"(numpy|np|torch|pathlib|collections|typing|types|enum|jaxtyping|pydantic)\..*"),
    # bounds of checked fields
    (
        r"py:.*",
        r"FieldInfo|NoneType|Ge|Le|Gt|Lt|MinLen|MaxLen|Len|Field|FitNumbers|.*TouchObject|.*LearntRig|_Side|_Squares|_Id|BeforeValidator|AfterValidator|[-+.\de]+",
    ),
    # what is imported for its type alone
    (r"py:class", r"Paint|Tensor|Mapping\[str|NamedAntennas|.*\.(Wanted|RigArrays|ContactEstimate)"),
    # a column's kind, as the table declares it
    (r"py:.*", r"(estimator\.table\.contacts\.)?(Number|Flag|Text|Whole)"),
]

html_theme = "furo"
html_title = "vbaa-calib"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_theme_options = {"navigation_with_keys": True}
html_copy_source = False
html_show_sphinx = False
templates_path: list[str] = []
pygments_style = "default"
pygments_dark_style = "native"

"""YAML as OpenCV, ROS and Python's calibration scripts write it, as plain tables.

OpenCV's own parser crashes on files nested deeply, and takes hours for others.
"""

import re
from collections import Counter
from typing import Any

import yaml

from ..errors import InputError
from ..files.tables import check_levels


class _Loader(yaml.CSafeLoader):
    """Reads tables, lists and scalars; what a tag such as ``!!opencv-matrix`` says, the keys say too.

    Scalars stay texts: YAML 1.1 takes 0120 for 80, and 20:00 for 1200.
    """

    yaml_implicit_resolvers: dict[str, list[Any]] = {}  # noqa: RUF012  # as PyYAML has it

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, object]:
        keys = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        if len(set(keys)) < len(keys):
            raise ValueError(f"it holds {Counter(keys).most_common(1)[0][0][:60]!r} twice in one table")
        return super().construct_mapping(node, deep)


def _untagged(loader: Any, tag: str, node: yaml.Node) -> object:
    if match := re.search(r"python/(object|name).*", tag):
        raise ValueError(f"it holds {match[0][:60]} in place of numbers: use float() and tolist() before yaml.dump")
    if isinstance(node, yaml.MappingNode):
        return loader.construct_mapping(node, deep=True)
    if isinstance(node, yaml.SequenceNode):
        return loader.construct_sequence(node, deep=True)
    return loader.construct_scalar(node)


_Loader.add_multi_constructor("", _untagged)


def yaml_table(text: str, where: str) -> object:
    """The content of a YAML text as dictionaries, lists, numbers and strings."""
    # OpenCV's first line, "%YAML:1.0", is no directive of YAML
    text = re.sub(r"\A\s*%YAML[^\n]*", "", text).expandtabs()
    try:
        # a list that is named again may grow without end
        if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, _Loader)):
            raise ValueError("it names a list again, as *id001: write each list out")
        # ROS ends what it prints with "---"
        documents = [part for part in yaml.load_all(text, _Loader) if part]
        table = documents[0] if len(documents) == 1 else documents
        check_levels(table)
        return table
    except (yaml.YAMLError, ValueError, TypeError, RecursionError) as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError(f"{where}: expected YAML, cannot read it ({reason}); correct it or write it again") from None

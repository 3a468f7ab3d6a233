"""YAML as people write it: 1e-3 is a number, a key that stands there twice is an error."""

import re
from pathlib import Path
from typing import Any

import yaml


class ConfigError(ValueError):
    """A config that cannot be used; the message names file, key, what was given and what would work."""


class _Loader(yaml.SafeLoader):
    """YAML 1.1 asks for a point and a sign in floats (1.0e-3); YAML 1.2 and people do not."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key, _ in node.value:
            if key.value in seen and isinstance(key, yaml.ScalarNode):
                raise yaml.constructor.ConstructorError(None, None, f"{key.value!r} is given twice", key.start_mark)
            if isinstance(key, yaml.ScalarNode):
                seen.add(key.value)
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(\d[\d_]*(\.[\d_]*)?|\.\d[\d_]*)[eE][-+]?\d+$"),
    list("-+.0123456789"),
)


def parse_yaml(text: str) -> Any:
    """The content of YAML (or JSON).

    Raises:
        yaml.YAMLError: it is not valid.
    """
    return yaml.load(text, Loader=_Loader)


def read_any_yaml(path: Path) -> Any:
    """The content of a file, whatever it is.

    Raises:
        ConfigError: it cannot be read, or is not YAML.
    """
    try:
        return parse_yaml(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path} is not a text file (UTF-8)") from error
    except yaml.YAMLError as error:
        raise ConfigError(f"{path} is not valid YAML: {' '.join(str(error).split())}") from error


def read_yaml(path: Path, example: str) -> dict[str, Any]:
    """The keys and values in a file.

    Args:
        path: of the file.
        example: of a line in such a file, for the message.

    Raises:
        ConfigError: it cannot be read, is not YAML, or holds something else.
    """
    content = read_any_yaml(path)
    if not isinstance(content, dict):
        what = "is empty" if content is None else f"holds {content!r:.60}"
        raise ConfigError(f"{path} {what}: it must hold keys and values, such as {example!r}")
    if odd := [key for key in content if not isinstance(key, str)]:
        raise ConfigError(f"{path}: keys must be words, got {', '.join(map(repr, odd))}")
    return content

"""Builds the peer: another tool makes its types, in another language, from the declared messages."""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from rover_hil.connect.ros2.messages import TYPE_HASHES, FieldType, Message, dds_name, field_types

SOURCE = Path(__file__).parent / "peer.cpp"
TYPES = "RosTypes"
IDL_OF = {
    "bool": "boolean",
    "byte": "octet",
    "uint8": "octet",
    "int32": "long",
    "uint32": "unsigned long",
    "float32": "float",
    "float64": "double",
    "string": "string",
}
TOOLS = ("fastddsgen", "g++")


def missing_tools() -> str:
    """Return which tools are missing; "" for none."""
    return ", ".join(tool for tool in TOOLS if shutil.which(tool) is None)


def parts_first(messages: Iterator[type[Message]]) -> list[type[Message]]:
    """Return messages with all their parts, each after what it consists of."""
    found: dict[type[Message], None] = {}

    def add(message: type[Message]) -> None:
        for kind in field_types(message).values():
            if not isinstance(kind.base, str):
                add(kind.base)
        found.setdefault(message)

    for message in messages:
        add(message)
    return list(found)


def idl_text() -> str:
    """Return the types in the interface definition language, as ROS 2 names them."""
    lines = []
    for message in parts_first(iter(TYPE_HASHES)):
        *modules, name = dds_name(message.ros_type).split("::")
        fields = [_idl_field(field, kind) for field, kind in field_types(message).items()]
        opening = " ".join(f"module {module} {{" for module in modules)
        lines.append(f"{opening} struct {name} {{ {' '.join(fields)} }}; {'}; ' * len(modules)}")
    return "\n".join(lines) + "\n"


def _idl_field(name: str, kind: FieldType) -> str:
    base = IDL_OF[kind.base] if isinstance(kind.base, str) else dds_name(kind.base.ros_type)
    if not kind.is_list:
        return f"{base} {name};"
    return f"sequence<{base}> {name};" if kind.size is None else f"{base} {name}[{kind.size}];"


def digest_text() -> str:
    """Return C++ that adds every field of every message to a digest, and lists the types."""
    lines = []
    for message in parts_first(iter(TYPE_HASHES)):
        lines.append(f"inline void add(Digest& digest, const {dds_name(message.ros_type)}& message) {{")
        for field, kind in field_types(message).items():
            if kind.is_list and kind.size is None:
                lines.append(f"  add(digest, static_cast<uint32_t>(message.{field}().size()));")
            lines.append(
                f"  for (const auto& item : message.{field}()) {{ add(digest, item); }}"
                if kind.is_list
                else f"  add(digest, message.{field}());"
            )
        lines.append("}")
    types = ", ".join(dds_name(message.ros_type) for message in TYPE_HASHES)
    lines.append(f"using Types = std::tuple<{types}>;")
    names = ", ".join(f'"{message.__name__}"' for message in TYPE_HASHES)
    lines.append(f"constexpr const char* NAMES[] = {{{names}}};")
    supports = ", ".join(f"{dds_name(message.ros_type)}PubSubType" for message in TYPE_HASHES)
    lines.append(f"using Supports = std::tuple<{supports}>;")
    return "\n".join(lines) + "\n"


def build(folder: Path) -> Path:
    """Build the peer into a folder, unless it is there and newer than its sources; return the program."""
    program = folder / "peer"
    folder.mkdir(parents=True, exist_ok=True)
    made = {folder / f"{TYPES}.idl": idl_text(), folder / "digest.hpp": digest_text()}
    is_same = all(path.exists() and path.read_text() == text for path, text in made.items())
    if is_same and program.exists() and program.stat().st_mtime > SOURCE.stat().st_mtime:
        return program
    for path, text in made.items():
        path.write_text(text)
    generated = folder / "generated"
    generated.mkdir(exist_ok=True)
    _run(["fastddsgen", "-replace", "-d", str(generated), str(folder / f"{TYPES}.idl")])
    sources = [str(SOURCE), *map(str, sorted(generated.glob(f"{TYPES}*.cxx")))]
    includes = [f"-I{generated}", f"-I{folder}"]
    _run(["g++", "-std=c++17", "-O1", *includes, *sources, "-lfastrtps", "-lfastcdr", "-o", str(program)])
    return program


def _run(line: list[str]) -> None:
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(line)}:\n{done.stdout[-4000:]}\n{done.stderr[-4000:]}")


if __name__ == "__main__":
    sys.stdout.write(f"{build(Path(sys.argv[1]))}\n")

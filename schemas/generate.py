"""Write the Python modules of schemas/symaware/v1/*.proto, each into the package that uses it.

    python schemas/generate.py           write them
    python schemas/generate.py --check   write nothing; exit 1 if what is there is stale

Needs grpcio-tools (in the `dev` extra).
"""

import argparse
import re
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent

#: The module that is made of each schema.
MODULES = {
    "symaware/v1/log.proto": "symaware_cli.log.symaware_v1_pb2",
    "symaware/v1/transport.proto": "symaware_cli.engine.network.transport_pb2",
}

OLDEST_RUNTIME = (6, 31, 0)
"""The oldest protobuf the package accepts (pyproject.toml).

The generator stamps its own version into its output, and a runtime refuses output that is newer than itself. What it
writes for these files has not changed since 5.26, so it is stamped with the oldest version instead: then everyone's
generator, whichever release, writes the same, too.
"""


def generated() -> dict[Path, str]:
    """Run the generator and return the text of each file to be written."""
    texts: dict[Path, str] = {}
    for proto, module in MODULES.items():
        code, stub = _translated(proto)
        path = HERE.parent.joinpath(*module.split(".")).with_suffix(".py")
        original = proto.removesuffix(".proto").replace("/", ".") + "_pb2"
        texts[path] = _stamped(code).replace(original, module)
        texts[path.with_suffix(".pyi")] = stub
    return texts


def _translated(proto: str) -> tuple[str, str]:
    from grpc_tools import protoc

    with tempfile.TemporaryDirectory() as folder:
        status = protoc.main(["protoc", f"-I{HERE}", f"--python_out={folder}", f"--pyi_out={folder}", proto])
        if status:
            raise SystemExit(f"protoc failed with status {status}")
        written = Path(folder, proto.removesuffix(".proto") + "_pb2.py")
        return written.read_text(encoding="utf-8"), written.with_suffix(".pyi").read_text(encoding="utf-8")


def _stamped(code: str) -> str:
    major, minor, patch = OLDEST_RUNTIME
    code = re.sub(r"(?m)^# Protobuf Python Version: .*$", f"# Protobuf Python Version: {major}.{minor}.{patch}", code)
    code, count = re.subn(
        r"(Domain\.PUBLIC,\n)    \d+,\n    \d+,\n    \d+,\n    '.*',\n",
        rf"\g<1>    {major},\n    {minor},\n    {patch},\n    '',\n",
        code,
    )
    if count != 1:
        raise SystemExit("protoc no longer stamps its version where this script looks for it")
    return code


def main() -> int:
    """Write the files, or compare them with what is there."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing; exit 1 if a file is stale")
    check = parser.parse_args().check
    stale = False
    for path, text in generated().items():
        if path.exists() and path.read_text(encoding="utf-8") == text:
            continue
        stale = True
        if check:
            print(f"{path.name} is stale: run `python schemas/generate.py`", file=sys.stderr)
        else:
            path.write_text(text, encoding="utf-8")
            print(f"wrote {path}")
    return int(check and stale)


if __name__ == "__main__":
    sys.exit(main())

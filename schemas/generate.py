"""Write symaware_cli/recording/symaware_v1_pb2.py(i) from schemas/symaware/v1/log.proto.

    python schemas/generate.py           write it
    python schemas/generate.py --check   write nothing; exit 1 if what is there is stale

Needs grpcio-tools (in the `dev` extra).
"""

import argparse
import re
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
PROTO = "symaware/v1/log.proto"
TARGET = HERE.parent / "symaware_cli" / "recording" / "symaware_v1_pb2.py"

OLDEST_RUNTIME = (6, 31, 0)
"""The oldest protobuf the package accepts (pyproject.toml).

The generator stamps its own version into its output, and a runtime refuses output that is newer than itself. What it
writes for this file has not changed since 5.26, so it is stamped with the oldest version instead: then everyone's
generator, whichever release, writes the same, too.
"""


def generated() -> dict[Path, str]:
    """Run the generator and return the text of each file to be written."""
    from grpc_tools import protoc

    with tempfile.TemporaryDirectory() as folder:
        status = protoc.main(["protoc", f"-I{HERE}", f"--python_out={folder}", f"--pyi_out={folder}", PROTO])
        if status:
            raise SystemExit(f"protoc failed with status {status}")
        written = Path(folder, PROTO)
        code = written.with_name("log_pb2.py").read_text(encoding="utf-8")
        stub = written.with_name("log_pb2.pyi").read_text(encoding="utf-8")
    major, minor, patch = OLDEST_RUNTIME
    code = re.sub(r"(?m)^# Protobuf Python Version: .*$", f"# Protobuf Python Version: {major}.{minor}.{patch}", code)
    code, count = re.subn(
        r"(Domain\.PUBLIC,\n)    \d+,\n    \d+,\n    \d+,\n    '.*',\n",
        rf"\g<1>    {major},\n    {minor},\n    {patch},\n    '',\n",
        code,
    )
    if count != 1:
        raise SystemExit("protoc no longer stamps its version where this script looks for it")
    code = code.replace("symaware.v1.log_pb2", "symaware_cli.recording.symaware_v1_pb2")
    return {TARGET: code, TARGET.with_suffix(".pyi"): stub}


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

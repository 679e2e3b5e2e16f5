"""Derive a certificate of SymAware again from the folder of its sweep, with the standard library alone.

python check_certificate.py DIR [CERTIFICATE]
Signatures are not checked. That the rows are those of the scenario is for repetition to show: symaware verify DIR.
"""

import base64
import json
import math
import sqlite3
import sys
from decimal import Decimal
from hashlib import sha256
from pathlib import Path

folder = Path(sys.argv[1])
read = json.loads(Path(sys.argv[2] if len(sys.argv) > 2 else folder / "certificate.json").read_bytes())
read = json.loads(base64.b64decode(read["payload"])) if "payload" in read else read
said, subject = read["predicate"], {each["name"]: each["digest"]["sha256"] for each in read["subject"]}
claim, cells = said["claim"], said["combinations"]
epsilon, alpha = (round(1 - claim[name], 12) for name in ("probability", "confidence"))


def canonical(value):  # RFC 8785, where keys have no characters beyond U+FFFF
    if isinstance(value, dict):
        return "{" + ",".join(f"{canonical(key)}:{canonical(value[key])}" for key in sorted(value)) + "}"
    if isinstance(value, list):
        return "[" + ",".join(map(canonical, value)) + "]"
    if (type(value) is int and abs(value) >= 2**53) or (type(value) is float and not math.isfinite(value)):
        value = str(value).replace("inf", "Infinity").replace("nan", "NaN")
    if type(value) is not float:
        return json.dumps(value, ensure_ascii=False)
    if 1e-6 <= abs(value) < 1e21:
        return f"{Decimal(repr(value)):f}".removesuffix(".0")
    return repr(value).replace("e-0", "e-") if value else "0"


def root(leaves):  # RFC 6962, section 2.1
    if len(leaves) < 2:
        return leaves[0] if leaves else sha256().digest()
    split = 1 << (len(leaves) - 1).bit_length() - 1
    return sha256(b"\1" + root(leaves[:split]) + root(leaves[split:])).digest()


def evidence(k, n):  # of k failures in n runs
    if claim["rule"] == "fixed":  # 1 / P(X <= k), X binomial
        return 1 / math.fsum(math.comb(n, i) * epsilon**i * (1 - epsilon) ** (n - i) for i in range(k + 1))
    # The mean likelihood ratio of sin(t)^2 to epsilon, t uniform: that is Beta(1/2, 1/2), truncated.
    angles = [math.asin(math.sqrt(epsilon)) * (i + 0.5) / 20_000 for i in range(20_000)]
    ratios = ((math.sin(t) ** 2 / epsilon, math.cos(t) ** 2 / (1 - epsilon)) for t in angles)
    return math.fsum(math.exp(k * math.log(one) + (n - k) * math.log(other)) for one, other in ratios) / 20_000


fields = ["index", "variant", "seed", "state", "digest", "error", "parameters", "verdicts", "robustness", "metrics"]
query = 'SELECT "{}" FROM runs ORDER BY "index"'.format('", "'.join(fields))
rows = [dict(zip(fields, row, strict=True)) for row in sqlite3.connect(folder / "journal.sqlite").execute(query)]
for row in rows:
    row.update({name: json.loads(row[name]) for name in fields[6:]}, seed=str(row["seed"]))
top = root([sha256(b"\0" + canonical(row).encode()).digest() for row in rows]).hex()
problems = [] if top == said["rows"]["root"] == subject["rows"] else [f"the rows have the root {top}"]
if sha256((folder / "sweep.yaml").read_bytes()).hexdigest() != subject["sweep.yaml"]:
    problems.append("sweep.yaml is another one")
for number, cell in enumerate(cells):
    mine = [row for row in rows if row["index"] % len(cells) == number]
    good = sum(row["state"] == "done" and row["verdicts"].get(claim["specification"]) == "satisfied" for row in mine)
    found, needed = evidence(len(mine) - good, len(mine)), len(cells) / alpha
    print(f"combination {number}: {len(mine)} runs, {len(mine) - good} against, evidence {found:.6g} of {needed:.6g}")
    if (len(mine), good, found >= needed) != (cell["runs"], cell["satisfied"], cell["established"]):
        problems.append(f"combination {number} is another one")
print(*problems or ["the certificate follows from the folder"], sep="\n")
sys.exit(bool(problems))

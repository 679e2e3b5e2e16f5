"""Derive a certificate of SymAware again from the folder of its sweep, with the standard library alone.

python check_certificate.py DIR [CERTIFICATE]
Signatures are not checked. That the rows are those of the scenario is for repetition to show: symaware verify DIR.
"""

import base64
import json
import sqlite3
import sys
from decimal import Decimal
from hashlib import sha256
from math import asin, comb, exp, fsum, isfinite, log, sin, sqrt
from pathlib import Path

folder = Path(sys.argv[1]) if sys.argv[1:] and Path(sys.argv[1]).is_dir() else sys.exit(__doc__)
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
    if isinstance(value, float) and isfinite(value):
        fixed = f"{Decimal(repr(value + 0.0)):f}".removesuffix(".0")  # -0.0 + 0.0 is 0.0
        return fixed if not value or 1e-6 <= abs(value) < 1e21 else repr(value).replace("e-0", "e-")
    text = json.dumps(value, ensure_ascii=False)
    is_text = text in ("NaN", "Infinity", "-Infinity") or (type(value) is int and abs(value) >= 2**53)
    return f'"{text}"' if is_text else text


def root(leaves):  # RFC 6962, section 2.1; split at the largest power of two below their number
    split = 2 ** (len(leaves) - 1).bit_length() // 2
    return leaves[0] if len(leaves) == 1 else sha256(b"\1" + root(leaves[:split]) + root(leaves[split:])).digest()


def evidence(k, n, e=Decimal(epsilon)):  # of k failures in n runs
    if claim["rule"] == "fixed":  # 1 / P(X <= k), X binomial
        return 1 / float(max(sum(comb(n, i) * e**i * (1 - e) ** (n - i) for i in range(k + 1)), Decimal("1e-300")))
    # The mean likelihood ratio of p = sin(t)^2 to epsilon, t uniform: that is Beta(1/2, 1/2), truncated.
    chances = (sin(asin(sqrt(epsilon)) * (i + 0.5) / 20_000) ** 2 for i in range(20_000))
    return fsum(exp(k * log(p / epsilon) + (n - k) * log((1 - p) / (1 - epsilon))) for p in chances) / 20_000


fields = ["index", "variant", "seed", "state", "digest", "error", "parameters", "verdicts", "robustness", "metrics"]
query = 'SELECT "{}" FROM runs ORDER BY "index"'.format('", "'.join(fields)).replace('"seed"', "CAST(seed AS TEXT)")
texts = sqlite3.connect(folder / "journal.sqlite").execute(query)
rows = [dict(zip(fields, (*row[:6], *map(json.loads, row[6:])), strict=True)) for row in texts]
top = root([sha256(b"\0" + canonical(row).encode()).digest() for row in rows] or [sha256().digest()]).hex()
agrees = {"the rows": top == said["rows"]["root"] == subject["rows"]}
agrees["sweep.yaml"] = sha256((folder / "sweep.yaml").read_bytes()).hexdigest() == subject["sweep.yaml"]
for number, cell in enumerate(cells):
    mine = [row for row in rows if row["index"] % len(cells) == number]
    good = sum(row["state"] == "done" and row["verdicts"].get(claim["specification"]) == "satisfied" for row in mine)
    found, needed = evidence(len(mine) - good, len(mine)), len(cells) / alpha
    print(f"combination {number}: {len(mine)} runs, {len(mine) - good} against, evidence {found:.6g} of {needed:.6g}")
    figures = {"runs": len(mine), "satisfied": good, "established": found >= needed}
    agrees[f"combination {number}"] = cell == cell | figures
problems = [f"not as certified: {name}" for name, is_so in agrees.items() if not is_so]
print(*problems or ["the certificate follows from the folder"], sep="\n")
sys.exit(bool(problems))

"""Derive a certificate of SymAware again from the folder of its sweep, with the standard library alone.

python check_certificate.py DIR [CERTIFICATE]

The claim is printed from the fields that machines read. Text, formula, scenario, plan and rows in the folder have to
agree with it; exit status 1 if something does not. Prose for readers carries no claim and is not read:
`probability_over`, `method`, `rows.hash`, `formula.semantics`, `formula.symaware`, the page, `as-written.yaml`. Neither
are signatures, the logs, the table in Parquet (the journal is what was certified), and of the journal seed_key, trace,
log and wall_time. That the rows are those of the scenario is for repetition to show: symaware verify DIR.
"""

import base64
import json
import re
import sqlite3
import sys
from contextlib import closing
from decimal import Decimal
from hashlib import sha256
from math import asin, comb, exp, fsum, isclose, isfinite, log, sin, sqrt
from pathlib import Path

folder = Path(sys.argv[1]) if sys.argv[1:] and Path(sys.argv[1]).is_dir() else sys.exit(__doc__)
file = Path(sys.argv[2]) if len(sys.argv) > 2 else folder / "certificate.json"


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


def evidence(k, n):  # of k failures in n runs
    if claim["rule"] == "fixed":  # 1 / P(X <= k), X binomial
        e = Decimal(epsilon)
        return 1 / float(max(sum(comb(n, i) * e**i * (1 - e) ** (n - i) for i in range(k + 1)), Decimal("1e-300")))
    # The mean likelihood ratio of p = sin(t)^2 to epsilon, t uniform: that is Beta(1/2, 1/2), truncated.
    chances = (sin(asin(sqrt(epsilon)) * (i + 0.5) / 20_000) ** 2 for i in range(20_000))
    return fsum(exp(k * log(p / epsilon) + (n - k) * log((1 - p) / (1 - epsilon))) for p in chances) / 20_000


def planned(name, default=""):  # a value of the plan, which has one key a line, and long texts over several
    found = re.search(rf"^{name}: *(.*(?:\n  .*)*)", plan, re.MULTILINE)
    return " ".join(found[1].split()).strip("'\"") if found else default


def stated_claim():  # by the plan
    found = re.fullmatch(CLAIM, planned("claim"))
    return found and (found[1], float(found[2]), float(found[3] or 0.99), found[4] or "fixed")


def of_statement():  # yields what has to agree with the folder, and whether it does
    yield "_type, predicateType", (read["_type"], read["predicateType"]) == KIND
    yield "claim.text", claim["text"] == "P({}) > {:.12g} with confidence {:.12g}, {}".format(*numbers)
    yield "claim in sweep.yaml", claim["stated"] == "post hoc" or stated_claim() == numbers
    yield "claim.stated", claim["stated"] in ("before the first run", "post hoc")
    sweep = {"scenario": planned("scenario").removeprefix("scenario/"), "seed": planned("seed", "0")}
    sweep |= {"runs_of_each_combination": int(planned("runs", "1")), "paired": planned("paired", "false") == "true"}
    yield "sweep", said["sweep"] == sweep
    formula = identity["resolved"]["specifications"][claim["specification"]]
    yield "formula.specification", canonical(said["formula"]["specification"]) == canonical(formula)
    yield "versions", said["versions"] == identity["versions"]
    yield "alpha", isclose(said["alpha"], alpha) and isclose(said["alpha_of_each_combination"], alpha / len(cells))
    yield "established", said["established"] == all(each["established"] for each in cells)


def of_files():
    assets = sorted(each.relative_to(folder).as_posix() for each in folder.glob("scenario/**/*") if each.is_file())
    yield "subject", [*subject] == ["rows", "sweep.yaml", "identity.json", *assets]
    for name in subject:
        path = folder / name
        yield name, name == "rows" or (path.is_file() and sha256(path.read_bytes()).hexdigest() == subject[name])
    content = {name: value for name, value in identity["resolved"].items() if name != "seed"}
    mixed = sha256(json.dumps(content, sort_keys=True).encode())
    for name in assets:
        if not name.endswith((".yaml", ".yml", ".toml")):
            mixed.update(name.removeprefix("scenario/").encode() + sha256((folder / name).read_bytes()).digest())
    yield "identity.json, resolved", mixed.hexdigest() == identity["cells"][0]
    yield "scenarios", [each["scenario"] for each in cells] == identity["cells"]


def of_rows():
    leaves = [sha256(b"\0" + canonical({name: row[name] for name in FIELDS}).encode()).digest() for row in rows]
    top = root(leaves or [sha256().digest()]).hex()
    yield "rows", top == said["rows"]["root"] == subject["rows"] and said["rows"]["count"] == len(rows)
    listed = file.with_suffix(".leaves")
    lines = [f"{row['index']} {leaf.hex()}\n" for row, leaf in zip(rows, leaves, strict=True)]
    yield listed.name, not listed.is_file() or listed.read_text() == "".join(lines)
    pinned = identity["versions"].get("Pinned") == "yes"
    harmless = ("SymAware from", *(("BLAS", "Processor", "platform") if pinned else ()))
    versions = {name: each for name, each in identity["versions"].items() if name not in harmless}
    for row in rows:
        scenario = identity["cells"][row["index"] % len(cells)]
        whole = [scenario, row["parameters"], row["variant"], row["index"], int(row["seed"]), versions]
        made = json.dumps([*whole, planned("claim")] if planned("claim") else whole, sort_keys=True)
        yield f"identity of row {row['index']}", sha256(made.encode()).hexdigest() == row["identity"]


def of_combinations():
    for number, cell in enumerate(cells):
        mine = [row for row in rows if row["index"] % len(cells) == number]
        verdicts = [row["verdicts"].get(claim["specification"]) or "undecided" for row in mine]
        became = [each if row["state"] == "done" else row["state"] for row, each in zip(mine, verdicts, strict=True)]
        good, n, k = became.count("satisfied"), len(mine), len(mine) - became.count("satisfied")
        found, needed = evidence(k, n), len(cells) / alpha
        print(f"combination {number}: {n} runs, {k} against, evidence {found:.6g} of {needed:.6g}")
        figures = {"runs": n, "satisfied": good, "established": found >= needed}
        figures["against"] = {name: became.count(name) for name in ("violated", "undecided", "failed", "lost")}
        yield f"combination {number}", cell == cell | figures and len(cell) == 10
        close = isclose(cell["evidence"], found, rel_tol=1e-3) and isclose(cell["needed"], needed, rel_tol=1e-6)
        enough = cell["runs_needed"]
        least = enough > k and evidence(k, enough) >= needed * (1 - 1e-6) > evidence(k, max(k, enough - 1)) * (1 - 2e-6)
        yield f"evidence of combination {number}", close and least
        fits = all(row["parameters"] == row["parameters"] | cell["parameters"] for row in mine)
        yield f"parameters of combination {number}", fits and all(row["variant"] == cell["variant"] for row in mine)


def derived(part):  # what cannot be derived at all does not agree
    try:
        yield from part()
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        yield f"{part.__name__}: {error!r}", False


KIND = ("https://in-toto.io/Statement/v1", "urn:symaware:sweep-certificate:1")
CLAIM = r"\s*P\(\s*(\S[^()]*?)\s*\)\s*>\s*(\S+?)(?:\s+with\s+confidence\s+([^\s,]+))?\s*(?:,\s*(\w+)\s*)?"
FIELDS = ("index", "variant", "seed", "state", "digest", "error", "parameters", "verdicts", "robustness", "metrics")
read = json.loads(file.read_bytes())
read = json.loads(base64.b64decode(read["payload"])) if "payload" in read else read
said, subject = read["predicate"], {each["name"]: each["digest"]["sha256"] for each in read["subject"]}
claim, cells = said["claim"], said["combinations"]
numbers = (claim["specification"], claim["probability"], claim["confidence"], claim["rule"])
epsilon, alpha = (round(1 - claim[name], 12) for name in ("probability", "confidence"))
plan, identity = (folder / "sweep.yaml").read_text(), json.loads((folder / "identity.json").read_bytes())
names = ("identity", *FIELDS)
query = 'SELECT "{}" FROM runs ORDER BY "index"'.format('", "'.join(names)).replace('"seed"', "CAST(seed AS TEXT)")
with closing(sqlite3.connect(folder / "journal.sqlite")) as journal:
    texts = journal.execute(query).fetchall()
rows = [dict(zip(names, (*row[:7], *map(json.loads, row[7:])), strict=True)) for row in texts]
print("the claim: P({}) > {} with confidence {}, {}; stated {}".format(*numbers, claim["stated"]))
checks = [each for part in (of_statement, of_files, of_rows, of_combinations) for each in derived(part)]
problems = [f"not as certified: {name}" for name, is_so in checks if not is_so]
print(*problems or ["the certificate follows from the folder"], sep="\n")
sys.exit(bool(problems))

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


def evidence(k, n, epsilon):  # of k failures in n runs
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
    terms = found and [re.fullmatch(TERM, each) for each in found[1].split(";")]
    return found and ([named(*term.groups()) for term in terms], float(found[2] or 0.99), found[3] or "fixed")


def named(satisfied, given, probability):  # a term: the names that are to be satisfied, those given, the bound
    return (*(re.split(r"\s+and\s+", names) if names else [] for names in (satisfied, given)), float(probability))


def text_of(satisfied, given, probability):
    return f"P({' and '.join(satisfied)}{' | ' * bool(given)}{' and '.join(given)}) > {probability:.12g}"


def outcome(row, satisfied, given):  # None where the condition is not met
    conditions, verdicts = ([row["verdicts"].get(name) or "undecided" for name in each] for each in (given, satisfied))
    if row["state"] != "done":
        return row["state"]
    if {*conditions} - {"satisfied"}:
        return None if "violated" in conditions else "undecided"
    return (
        "violated" if "violated" in verdicts else next((each for each in verdicts if each != "satisfied"), "satisfied")
    )


def of_statement():  # yields what has to agree with the folder, and whether it does
    yield "_type, predicateType", (read["_type"], read["predicateType"]) == KIND
    yield "claim.text", claim["text"] == CLAIMED
    yield "claim in sweep.yaml", claim["stated"] == "post hoc" or stated_claim() == (terms, *decision)
    yield "claim.stated", claim["stated"] in ("before the first run", "post hoc")
    sweep = {"scenario": planned("scenario").removeprefix("scenario/"), "seed": planned("seed", "0")}
    sweep |= {"runs_of_each_combination": int(planned("runs", "1")), "paired": planned("paired", "false") == "true"}
    yield "sweep", said["sweep"] == sweep
    stated = {**identity["resolved"].get("contracts", {}), **identity["resolved"].get("specifications", {})}
    names = dict.fromkeys(name for satisfied, given, _ in terms for name in (*satisfied, *given))
    formulas = {"specifications": {name: stated[name] for name in names}} if "terms" in claim else None
    formula = {name: said["formula"][name] for name in said["formula"] if name not in ("semantics", "symaware")}
    yield "formula", canonical(formula) == canonical(formulas or {"specification": stated[claim["specification"]]})
    yield "versions", said["versions"] == identity["versions"]
    yield (
        "alpha",
        isclose(said["alpha"], alpha) and isclose(said["alpha_of_each_combination"], alpha / len(cells) / len(terms)),
    )
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
        parts = cell["terms"] if "terms" in claim else [cell]
        for part, term in zip(parts, terms, strict=True):
            yield from of_term(f"combination {number}{f', {text_of(*term)}' * ('terms' in claim)}", part, mine, *term)
        if "terms" in claim:
            yield f"runs of combination {number}", cell["runs"] == len(mine) and len(cell) == 6
            yield f"combination {number}", cell["established"] == all(part["established"] for part in parts)
        fits = all(row["parameters"] == row["parameters"] | cell["parameters"] for row in mine)
        yield f"parameters of combination {number}", fits and all(row["variant"] == cell["variant"] for row in mine)


def of_term(place, part, mine, satisfied, given, probability):
    became = [outcome(row, satisfied, given) for row in mine]
    became, epsilon = [each for each in became if each], round(1 - probability, 12)
    good, n, k = became.count("satisfied"), len(became), len(became) - became.count("satisfied")
    found, needed = evidence(k, n, epsilon), len(cells) * len(terms) / alpha
    print(f"{place}: {n} runs, {k} against, evidence {found:.6g} of {needed:.6g}")
    figures = {"satisfied": good, "established": found >= needed}
    figures |= {"counted": n, "text": text_of(satisfied, given, probability)} if "terms" in claim else {"runs": n}
    figures["against"] = {name: became.count(name) for name in ("violated", "undecided", "failed", "lost")}
    yield place, part == part | figures and len(part) == (8 if "terms" in claim else 10)
    close = isclose(part["evidence"], found, rel_tol=1e-3) and isclose(part["needed"], needed, rel_tol=1e-6)
    enough = part["runs_needed"]
    before = evidence(k, max(k, enough - 1), epsilon)
    least = enough > k and evidence(k, enough, epsilon) >= needed * (1 - 1e-6) > before * (1 - 2e-6)
    yield f"evidence of {place}", close and least


def derived(part):  # what cannot be derived at all does not agree
    try:
        yield from part()
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        yield f"{part.__name__}: {error!r}", False


KIND = ("https://in-toto.io/Statement/v1", "urn:symaware:sweep-certificate:1")
CLAIM = r"(.*?>\s*[0-9.eE+-]+)(?:\s+with\s+confidence\s+([^\s,]+))?\s*(?:,\s*(\w+)\s*)?"
TERM = r"\s*P\(\s*([^()|\s][^()|]*?)\s*(?:\|\s*([^()|\s][^()|]*?)\s*)?\)\s*>\s*(\S+)\s*"
FIELDS = ("index", "variant", "seed", "state", "digest", "error", "parameters", "verdicts", "robustness", "metrics")
read = json.loads(file.read_bytes())
read = json.loads(base64.b64decode(read["payload"])) if "payload" in read else read
said, subject = read["predicate"], {each["name"]: each["digest"]["sha256"] for each in read["subject"]}
claim, cells = said["claim"], said["combinations"]
plain = [{"satisfied": [claim.get("specification")], "given": [], "probability": claim.get("probability")}]
terms = [(each["satisfied"], each["given"], each["probability"]) for each in claim.get("terms", plain)]
decision, alpha = (claim["confidence"], claim["rule"]), round(1 - claim["confidence"], 12)
CLAIMED = "; ".join(text_of(*term) for term in terms) + " with confidence {:.12g}, {}".format(*decision)
plan, identity = (folder / "sweep.yaml").read_text(), json.loads((folder / "identity.json").read_bytes())
names = ("identity", *FIELDS)
query = 'SELECT "{}" FROM runs ORDER BY "index"'.format('", "'.join(names)).replace('"seed"', "CAST(seed AS TEXT)")
with closing(sqlite3.connect(folder / "journal.sqlite")) as journal:
    texts = journal.execute(query).fetchall()
rows = [dict(zip(names, (*row[:7], *map(json.loads, row[7:])), strict=True)) for row in texts]
print(f"the claim: {CLAIMED}; stated {claim['stated']}")
checks = [each for part in (of_statement, of_files, of_rows, of_combinations) for each in derived(part)]
problems = [f"not as certified: {name}" for name, is_so in checks if not is_so]
print(*problems or ["the certificate follows from the folder"], sep="\n")
sys.exit(bool(problems))

"""Reading of sweep folders, including those of unfinished and running sweeps."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from symaware_cli.language import FilePath

if TYPE_CHECKING:
    import pyarrow

    from symaware_cli.studies.findings import VariantDifference, VerdictShare


def require_pyarrow() -> None:
    """Check that PyArrow, which tables need, is installed.

    Raises:
        LogError: PyArrow is not installed.
    """
    from importlib.util import find_spec

    from symaware_cli.log import LogError

    if find_spec("pyarrow") is None:
        raise LogError("a sweep needs the module `pyarrow`, which is not installed: pip install 'symaware-cli[sweep]'")


def read_rows(
    folder: FilePath,
    where: str | None = None,
    sort: str | None = None,
    limit: int | None = None,
    columns: Iterable[str] = (),
) -> tuple[pyarrow.Table, int]:
    """Read rows of a sweep, which may be unfinished or running.

    Args:
        folder: The folder of the sweep.
        where: See `symaware_cli.studies.sweep_query.query`.
        sort: See `symaware_cli.studies.sweep_query.query`.
        limit: See `symaware_cli.studies.sweep_query.query`.
        columns: The columns; by default all.

    Returns:
        The rows, and the number of planned runs.

    Raises:
        SweepError: There is no sweep, or the condition is invalid.
        UnknownNameError: There is no such column.
    """
    folder = Path(folder)
    require_pyarrow()
    from symaware_cli.studies import table_file
    from symaware_cli.studies.sweep_error import SweepError
    from symaware_cli.studies.sweep_files import is_sweep
    from symaware_cli.studies.sweep_query import column, query

    if not is_sweep(folder):
        raise SweepError(f"{folder} is not the folder of a sweep")
    found = table_file.read(Path(folder))
    if found is None:
        from symaware_cli.studies.folder import SweepFolder
        from symaware_cli.studies.session import rows_so_far

        sweep = SweepFolder.opened(folder)
        found = rows_so_far(sweep), sweep.plan.count
    table, planned = found
    table = query(table, where, sort, limit)
    names = [column(table, name) for name in columns]
    return (table.select(names) if names else table), planned


def read_shares(folder: Path) -> Sequence[VerdictShare]:
    """Return the share of the runs that satisfy each specification, for each combination and variant.

    Raises:
        SweepError: There is no sweep.
    """
    require_pyarrow()
    from symaware_cli.studies.findings import shares
    from symaware_cli.studies.folder import SweepFolder
    from symaware_cli.studies.session import rows_so_far

    sweep = SweepFolder.opened(folder)
    return list(shares(rows_so_far(sweep), sweep.plan))


def read_differences(folder: Path, name: str) -> Sequence[VariantDifference]:
    """Return the paired difference of each variant from the first one, in one column.

    Raises:
        SweepError: There is no sweep, or its variants cannot be compared.
        UnknownNameError: There is no such column.
    """
    require_pyarrow()
    from symaware_cli.studies.findings import differences
    from symaware_cli.studies.folder import SweepFolder
    from symaware_cli.studies.session import rows_so_far

    sweep = SweepFolder.opened(folder)
    return list(differences(rows_so_far(sweep), sweep.plan, name))

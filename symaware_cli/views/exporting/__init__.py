"""Export of logs as tables, for pandas, Polars, R, MATLAB or spreadsheets."""

"""Export of logs as CSV or Parquet tables, for pandas, Polars, R, MATLAB or spreadsheets."""

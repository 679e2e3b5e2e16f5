"""Tables of a log, for whoever goes on in pandas, Polars, R, MATLAB or a spreadsheet."""

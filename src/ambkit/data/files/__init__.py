"""The formats of logs: CSV of any kind, Parquet, MATLAB, HDF5, MDF; and times as text."""

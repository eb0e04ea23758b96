"""Display of results: tables for the terminal, plots and figures for print."""

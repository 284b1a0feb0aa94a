"""The workbench in the browser: a job is edited, simulated and judged while one watches."""

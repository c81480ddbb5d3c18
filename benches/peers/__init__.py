"""What `benches/compare.py` measures: this project's engines and fits beside others, one file each."""

"""Reads flight logs (ULog, tlog), keeps their files, and answers with what a person looks at: an overview and
plotted values. Logs are untrusted: they are read in processes of their own (`worker.py`)."""

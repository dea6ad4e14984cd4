"""The guided recorder: the paper's protocol, a writer that survives kills and full
disks, and a check of each take."""

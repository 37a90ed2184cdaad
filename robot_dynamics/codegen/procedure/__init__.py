"""Procedures as machine code: symbols, staging, and the text of LLVM IR that results."""

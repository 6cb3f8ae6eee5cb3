"""Forged and mutated certificates, of which no checker may accept one."""

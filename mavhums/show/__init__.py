"""Presentation of results: blocks of what is said, drawn as text, Markdown, HTML, or a Rerun recording.

This package does not judge.
"""

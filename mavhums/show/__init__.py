"""Presentation of results: blocks of words and figures, drawn as text, Markdown, HTML, or a Rerun recording.

This package does not judge.
"""

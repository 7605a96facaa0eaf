"""Textbook pieces without physics: factorisations, splines, bases."""

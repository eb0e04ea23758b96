"""The model behind the page: question and answer, independent of the user interface."""

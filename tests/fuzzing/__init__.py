"""A campaign of damaged and odd inputs: `make fuzz`, or `PYTHONPATH=tests python -m fuzzing --help`.

`samples` has a good file of every format that the program reads; `mutations` and `image_mutations` change it, `drawn`
draws others from scratch. `kinds` makes a command line of them, `checks` runs it and says what is wrong, and `pool`
does that many times in processes of its own.
"""

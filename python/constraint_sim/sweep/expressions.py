"""Arithmetic in study files: `1/60`, `sqrt(2)`, `cos(omega * t)`. Nothing else is evaluated."""
import ast
import math

import numpy as np

FUNCTIONS = {name: getattr(np, name) for name in (
    'sin', 'cos', 'tan', 'arcsin', 'arccos', 'arctan', 'arctan2', 'sinh', 'cosh', 'tanh', 'exp', 'log', 'sqrt',
    'abs', 'minimum', 'maximum', 'floor')}
TWO_ARGUMENTS = ('arctan2', 'minimum', 'maximum')  # all others have one
CONSTANTS = {'pi': math.pi}
TIME = 't'  # in closed forms
RESERVED = frozenset((*FUNCTIONS, *CONSTANTS, TIME))  # names that stand for something already
MOST_CHARACTERS = 1000
OPERATORS = {ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide,
             ast.Pow: np.power, ast.Mod: np.mod}


class ExpressionError(ValueError):
    pass


def parse(text):
    words = str(text).strip()
    if len(words) > MOST_CHARACTERS:
        raise ExpressionError(f'an expression has {len(words)} characters, more than {MOST_CHARACTERS}')
    try:
        return ast.parse(words, mode='eval').body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ExpressionError(f'not an expression: {text!r}') from None


def value(text, variables=None):
    """Returns the value of an expression; variables may be arrays."""
    with np.errstate(all='ignore'):  # who asks for the value looks at what is finite
        try:
            return _value(parse(text), variables or {}, text)
        except (TypeError, ValueError, OverflowError, RecursionError) as error:
            if isinstance(error, ExpressionError):
                raise
            raise ExpressionError(f'{text!r}: {error}') from None


def _value(node, variables, text):
    if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)) and \
            not isinstance(node.value, bool):
        return float(node.value)
    if isinstance(node, ast.Name) and node.id in variables:
        return variables[node.id]
    if isinstance(node, ast.Name) and node.id in CONSTANTS:
        return CONSTANTS[node.id]
    if isinstance(node, ast.Name):
        raise ExpressionError(f'{text!r}: there is no {node.id!r}; there are '
                              + ', '.join(sorted({*variables, *CONSTANTS})))
    if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        return OPERATORS[type(node.op)](_value(node.left, variables, text),
                                        _value(node.right, variables, text))
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
        inner = _value(node.operand, variables, text)
        return -inner if isinstance(node.op, ast.USub) else inner
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        if node.func.id not in FUNCTIONS:
            raise ExpressionError(f'{text!r}: there is no function {node.func.id!r}; there are '
                                  + ', '.join(sorted(FUNCTIONS)))
        wanted = 2 if node.func.id in TWO_ARGUMENTS else 1
        if len(node.args) != wanted:  # numpy would write its result into one more
            raise ExpressionError(f'{text!r}: {node.func.id} has {wanted} arguments, got {len(node.args)}')
        values = [_value(argument, variables, text) for argument in node.args]
        return FUNCTIONS[node.func.id](*values)
    raise ExpressionError(f'{text!r}: {type(node).__name__} is no arithmetic')

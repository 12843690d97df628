"""Arithmetic in study files: `1/60`, `sqrt(2)`, `cos(omega * t)`. Nothing else is evaluated."""
import ast
import math

import numpy as np

FUNCTIONS = {name: getattr(np, name) for name in (
    'sin', 'cos', 'tan', 'arcsin', 'arccos', 'arctan', 'arctan2', 'sinh', 'cosh', 'tanh', 'exp', 'log', 'sqrt',
    'abs', 'minimum', 'maximum', 'floor')}
CONSTANTS = {'pi': math.pi}
OPERATORS = {ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide,
             ast.Pow: np.power, ast.Mod: np.mod}


class ExpressionError(ValueError):
    pass


def parse(text):
    try:
        return ast.parse(str(text).strip(), mode='eval').body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ExpressionError(f'not an expression: {text!r}') from None


def value(text, variables=None):
    """Of an expression; variables may be arrays."""
    with np.errstate(all='ignore'):  # who asks for the value looks at what is finite
        return _value(parse(text), variables or {}, text)


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
        values = [_value(argument, variables, text) for argument in node.args]
        try:
            return FUNCTIONS[node.func.id](*values)
        except (TypeError, ValueError) as error:
            raise ExpressionError(f'{text!r}: {error}') from None
    raise ExpressionError(f'{text!r}: {type(node).__name__} is no arithmetic')

"""A page as a list of blocks, written as Markdown and as HTML. Texts use Markdown for `code`, **bold** and links."""
import collections
import html
import re

import package_path  # noqa: F401
from constraint_sim.sweep import report_pages

Heading = collections.namedtuple('Heading', 'text')
Text = collections.namedtuple('Text', 'text')
Items = collections.namedtuple('Items', 'texts')
Numbered = collections.namedtuple('Numbered', 'texts')
Picture = collections.namedtuple('Picture', 'file alt')
Table = collections.namedtuple('Table', 'header lines')
Folded = collections.namedtuple('Folded', 'title blocks')


def markdown(block):
    if isinstance(block, Heading):
        return f'## {block.text}\n'
    if isinstance(block, Text):
        return block.text + '\n'
    if isinstance(block, Items):
        return ''.join(f'- {text}\n' for text in block.texts)
    if isinstance(block, Numbered):
        return ''.join(f'{number}. {text}\n' for number, text in enumerate(block.texts, 1))
    if isinstance(block, Picture):
        return f'![{block.alt}]({block.file})\n'
    if isinstance(block, Table):
        return report_pages.markdown_table(block.header, block.lines)
    return (f'<details><summary>{html.escape(block.title)}</summary>\n\n' + '\n'.join(map(markdown, block.blocks)) +
            '\n</details>\n')


def anchor(heading):
    """Returns the anchor that GitHub gives a heading of letters and spaces."""
    return heading.lower().replace(' ', '-')


def inline(text):
    """Returns a text as HTML."""
    text = html.escape(text)
    text = re.sub(r'`([^`]+)`', r'<code>\1</code>', text)
    text = re.sub(r'\*\*([^*]+)\*\*', r'<b>\1</b>', text)
    return re.sub(r'\[([^\]]+)\]\(([^)]+)\)', r'<a href="\2">\1</a>', text)


def listed(tag, texts):
    return f'<{tag}>' + '\n'.join(f'<li>{inline(text)}</li>' for text in texts) + f'</{tag}>'


def as_html(block):
    if isinstance(block, Heading):
        return f'<h2 id="{anchor(block.text)}">{inline(block.text)}</h2>'
    if isinstance(block, Text):
        return f'<p>{inline(block.text)}</p>'
    if isinstance(block, Items):
        return listed('ul', block.texts)
    if isinstance(block, Numbered):
        return listed('ol', block.texts)
    if isinstance(block, Picture):
        return f'<p><img src="{block.file}" alt="{html.escape(block.alt)}"></p>'
    if isinstance(block, Table):
        rows = [''.join(f'<th>{inline(cell)}</th>' for cell in block.header)]
        rows += [''.join(f'<td>{inline(cell)}</td>' for cell in line) for line in block.lines]
        return '<table>' + '\n'.join(f'<tr>{row}</tr>' for row in rows) + '</table>'
    return (f'<details><summary>{html.escape(block.title)}</summary>\n' + '\n'.join(map(as_html, block.blocks)) +
            '\n</details>')


def write_markdown(path, title, blocks):
    path.write_text(f'# {title}\n\n' + '\n'.join(map(markdown, blocks)))


def write_html(path, title, blocks, rest=''):
    """Writes a page; `rest` is HTML that follows the blocks."""
    path.write_text(report_pages.page(title, '\n'.join(map(as_html, blocks)) + rest))

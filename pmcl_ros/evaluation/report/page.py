"""The page: one file, nothing outside it."""

from importlib.resources import files
from string import Template
from xml.etree.ElementTree import Element

from pmcl_ros.evaluation.report.epipolar import epipolar_section
from pmcl_ros.evaluation.report.evidence import evidence_section
from pmcl_ros.evaluation.report.localization import Localization
from pmcl_ros.evaluation.report.markup import element, html
from pmcl_ros.evaluation.report.posterior import posterior_section
from pmcl_ros.evaluation.report.search import search_section
from pmcl_ros.evaluation.report.slices import slices_section
from pmcl_ros.evaluation.report.summary import (
    about,
    settings_section,
    times_section,
    verdict,
)
from pmcl_ros.evaluation.report.views import views_section

_SECTIONS = (views_section, posterior_section, evidence_section, epipolar_section,
             slices_section, search_section, times_section, settings_section)


def page(run: Localization) -> str:
    """The report of a localisation, an HTML file's text."""
    folder = files('pmcl_ros.evaluation.report')
    template = Template((folder / 'page.html').read_text(encoding='utf-8'))
    style = (folder / 'page.css').read_text(encoding='utf-8')
    sections = [make(run) for make in _SECTIONS]
    body = element('main', element('header', element('h1', 'Localisation report'), about(run)),
                   verdict(run), _contents(sections), *sections)
    title = html(element('title', f'{run.model.name}: localisation report'))
    return template.substitute(title=title, style=style, body=html(body))


def _contents(sections: list[Element]) -> Element:
    return element('nav', *(element('a', each[0].text, href=f'#{each.get("id")}')
                            for each in sections))

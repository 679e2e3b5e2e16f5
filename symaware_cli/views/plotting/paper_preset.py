"""Presets of figures for papers: width, type, and colours that can also be told apart in grey."""

from __future__ import annotations

from dataclasses import dataclass

#: Colours by ascending lightness: about 0.10, 0.26, 0.39, 0.46, 0.57 and 0.69 in grey.
GREY_SAFE = ("#1a1a1a", "#0b4f9e", "#b5452c", "#3a9a5b", "#d08a1e", "#7fbfe8")

#: Width below which the panels of a figure are one below the other [inch].
NARROW = 5.0


@dataclass(frozen=True)
class PaperPreset:
    """A preset.

    Attributes:
        name: The name of the preset.
        width: Width of a figure [inch].
        font: The family of the font, which must be among those of matplotlib.
        size: The size of type [points].
    """

    name: str
    width: float
    font: str
    size: float

    @property
    def narrow(self) -> bool:
        """Whether all panels are in one column."""
        return self.width < NARROW


#: Widths of columns and of pages: IEEE 21 and 43 picas (IEEE Author Center, "Preparing figures"), ACM 241 and 506
#: points (acmart, sigconf), Springer LNCS 122 mm (llncs).
PRESETS = {
    preset.name: preset
    for preset in (
        PaperPreset("ieee-column", 3.5, "STIXGeneral", 8.0),
        PaperPreset("ieee-page", 7.16, "STIXGeneral", 8.0),
        PaperPreset("acm-column", 3.33, "STIXGeneral", 8.0),
        PaperPreset("acm-page", 7.0, "STIXGeneral", 8.0),
        PaperPreset("lncs", 4.8, "STIXGeneral", 8.0),
    )
}

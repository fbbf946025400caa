"""The labs' Chinese, sentence by sentence, in the terms of docs/course_terms.md, and of nothing else."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from sinan.experiments.student_labs import TITLES
from sinan.experiments.student_labs.files import notebook
from sinan.experiments.student_labs.lab import lab_of

PAGE = (Path(__file__).parents[2] / "docs" / "course_terms.md").read_text(encoding="utf-8")
TEXTS = Path(notebook.__code__.co_filename).parent / "texts"
#: What of a long term stands for it once it has been named.
SHORT = {
    "三轴加速度计": "加速度计",
    "三轴陀螺仪": "陀螺仪",
    "三轴磁力计": "磁力计",
    "超声波测距仪": "超声波",
    "全球定位系统": "GPS",
    "针孔成像模型": "针孔",
    "性能指标": "指标",
    "重力加速度": "g =",
}
#: Common words of other books for what the course has its own for.
OTHERS = (
    "磁强计",
    "磁力仪",
    "比例因子",
    "标度因数",
    "刻度因子",
    "零偏",
    "参考站",
    "基站",
    "超声波传感器",
    "代价函数",
    "目标函数",
    "航向",
    "回波",
    "相机",
    "照相机",
    "内参",
    "横滚",
    "翻滚",
    "范数",
    "模值",
    "余差",
    "载体系",
    "弹体",
    "世界坐标系",
    "测距码",
    "修正值",
    "改正值",
    "投影矩阵",
    "棋盘板",
    "随机漫步",
    "比力计",
    "声纳",
    "声呐",
    "高度计",
    "钟偏",
    "定标",
)


def terms() -> dict[str, tuple[str, ...]]:
    """English term -> the Chinese ones that stand for it."""
    found: dict[str, tuple[str, ...]] = {}
    for row in re.findall(r"^\| (.*?) \| (.*?) \|", PAGE, re.MULTILINE):
        chinese, english = (re.split("；|;", re.sub(r"[(（].*?[)）]", "", cell)) for cell in row)
        chinese, english = [c.strip() for c in chinese], [e.strip() for e in english]
        if len(chinese) == len(english):
            pairs = [(e, (c,)) for c, e in zip(chinese, english, strict=True)]
        else:
            pairs = [(e, tuple(chinese)) for e in english]
        for word, of_it in pairs:
            if re.search("[一-鿿]", of_it[0]):
                found[word] = (*found.get(word, ()), *of_it)
    return found


def sentences(name: str) -> list[tuple[str, str]]:
    """What stands in both languages: paragraphs of the notebook, hints."""
    source = (TEXTS / f"{name}.notebook").read_text(encoding="utf-8")
    blocks = re.findall(r"((?:^# en:.*\n)+)((?:^# zh:.*\n)+)", source, re.MULTILINE)
    pairs = [tuple(re.sub(r"^# (en|zh): ?", " ", text, flags=re.MULTILINE) for text in block) for block in blocks]
    words = [w for q in lab_of(name).questions for w in (q.hint, *(m.hint for m in q.mistakes))]
    return [*((en, zh) for en, zh in pairs), *((w.en, w.zh) for w in words)]


@pytest.mark.parametrize("name", TITLES)
def test_each_term_is_the_course_s(name: str) -> None:
    wrong = [
        (word, " or ".join(of_it), zh.strip())
        for en, zh in sentences(name)
        for word, of_it in terms().items()
        if re.search(rf"(?<![\w`]){re.escape(word)}(s|es)?(?![\w`])", re.sub(r"\s+", " ", en), re.IGNORECASE)
        if not any(c in zh or SHORT.get(c, c) in zh for c in of_it)
    ]
    assert not wrong, "\n".join(map(str, wrong))


@pytest.mark.parametrize("name", TITLES)
def test_no_word_of_another_book(name: str) -> None:
    told = notebook(name, "zh") + TITLES[name][1] + "".join(zh for _, zh in sentences(name))
    assert not [word for word in OTHERS if word in told]


def test_the_table_is_read() -> None:
    found = terms()
    assert found["scale"] == ("尺度因子",)
    assert found["pitch"] == ("俯仰角",)
    assert len(found) > 60

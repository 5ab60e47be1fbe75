//! The page: one HTML file that needs nothing else, for the engineer who wants to know whether to trust a method, and for
//! the researcher who wants to know why.
//!
//! Whatever depends on time is in elements of class `time`, so that the rest of two pages can be compared.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::html::Html;
use super::plots::{about, milliseconds, plain};
use super::report::{MethodReport, NamedLoss, Report};
use super::statistics::Distribution;
use crate::human::grouped;
use crate::visibility::Method;

/// What the page shows besides the report's figures.
pub struct PageParts {
    /// [`super::plots::pareto`].
    pub pareto: String,
    /// [`super::plots::stages`].
    pub stages: String,
    /// [`super::plots::spread`].
    pub spread: String,
    /// [`super::plots::frames`], of a path.
    pub frames: Option<String>,
    /// Pictures of the worst views.
    pub worst: Vec<WorstPage>,
}

/// Pictures of one method's worst view, PNG.
pub struct WorstPage {
    /// Index into [`Report::methods`].
    pub method: usize,
    /// What there is to see.
    pub reference: Vec<u8>,
    /// What the method's answer shows.
    pub answer: Vec<u8>,
    /// Both, enlarged where most is lost.
    pub detail: Vec<u8>,
    /// Pixels with a lost sample.
    pub lost_pixels: u64,
}

/// Objects in the tables of lost ones.
const LISTED_OBJECTS: usize = 15;

/// Writes the page.
pub fn page(report: &Report, parts: &PageParts) -> String {
    let mut html = Html::default();
    html.open("html", &[("lang", "en")]).open("head", &[]);
    html.open("meta", &[("charset", "utf-8")]);
    html.open("meta", &[("name", "viewport"), ("content", "width=device-width, initial-scale=1")]);
    html.element("title", &[], &title(report));
    html.open("style", &[]).trusted(include_str!("page.css")).close();
    html.close().open("body", &[]);
    heading(&mut html, report);
    in_short(&mut html, report);
    summary(&mut html, report);
    papers(&mut html, report);
    how_to_read(&mut html, report);
    charts(&mut html, parts);
    worst_views(&mut html, report, &parts.worst);
    lost_objects(&mut html, report);
    how_it_was_done(&mut html, report);
    html.finish()
}

fn title(report: &Report) -> String {
    let scene = report.scenes.first().map_or("", |scene| &scene.file);
    format!("Culling compared: {scene}")
}

fn heading(html: &mut Html, report: &Report) {
    html.element("h1", &[], &title(report));
    let Some(scene) = report.scenes.first() else { return };
    let resolutions: Vec<String> =
        report.scenes.iter().map(|scene| format!("{}\u{b3}", scene.resolution)).collect();
    let text = format!(
        "{} objects, {} drawables, {} triangles; voxels {}; {}",
        grouped(scene.objects),
        grouped(scene.drawables),
        grouped(scene.triangles),
        resolutions.join(", "),
        report.settings.views
    );
    html.element("p", &[("class", "soft")], &text);
}

/// One sentence a method, for those who read no further.
fn in_short(html: &mut Html, report: &Report) {
    html.open("section", &[]).element("h2", &[], "In short");
    for index in report.representatives() {
        let method = &report.methods[index];
        html.open("p", &[]).element("b", &[], &method.variant.to_string()).text(": ");
        html.element("span", &[("class", "time")], &milliseconds(method.time.distribution.median));
        html.text(" a view; ");
        let lost = &method.lost_pixels;
        if lost.worst == 0.0 {
            html.text("lost nothing in any view");
        } else {
            html.text(&format!(
                "lost {} of the visible pixels on average, {} in the worst view ({})",
                percent(lost.mean),
                percent(lost.worst),
                view_name(report, lost.worst_view)
            ));
            if let Some(worst) = method.lost.first() {
                html.text("; most of it from ").element("i", &[], &worst.path);
            }
        }
        html.text(&format!("; draws {} of its drawables for nothing", percent(method.needlessly_drawn.mean)));
        if method.is_floor {
            html.text(". This is the sampling floor: what triangles tell with these rays");
        }
        html.text(".").close();
    }
    html.close();
}

fn summary(html: &mut Html, report: &Report) {
    html.open("section", &[]).element("h2", &[], "Run time against error");
    html.open("div", &[("class", "scroll")]).open("table", &[("id", "summary")]).open("thead", &[]);
    html.open("tr", &[]).element("th", &[], "");
    let groups = [
        ("3", "a view"),
        ("5", "lost pixels"),
        ("4", "wrongly hidden, of drawables with"),
        ("3", "drawn for nothing"),
    ];
    for (span, text) in groups {
        html.element("th", &[("colspan", span)], text);
    }
    html.close().open("tr", &[]).element("th", &[("class", "name")], "method");
    let columns = [
        "time, median",
        "time, 95 %",
        "rays a pixel",
        "mean",
        "95 %",
        "worst",
        "\u{d7} floor",
        "views with loss",
        "any",
        "\u{2265} 1 px",
        "\u{2265} 4 px",
        "\u{2265} 16 px",
        "drawables",
        "triangles",
        "culled",
    ];
    for column in columns {
        html.element("th", &[], column);
    }
    html.close().close().open("tbody", &[]);
    for (index, method) in report.methods.iter().enumerate() {
        summary_row(html, report, index, method);
    }
    html.close().close().close();
    let text = "Means over views unless said otherwise; a view that shows no drawable of a size has no part in that column. \
                Rows on grey are the sampling floor.";
    html.element("p", &[("class", "soft")], text).close();
}

fn summary_row(html: &mut Html, report: &Report, index: usize, method: &MethodReport) {
    let index = index.to_string();
    let class = if method.is_floor { "floor" } else { "method" };
    html.open("tr", &[("class", class), ("data-method", &index)]);
    html.element("td", &[("class", "name")], &method.variant.to_string());
    for seconds in [method.time.distribution.median, method.time.distribution.p95] {
        html.element("td", &[("class", "time")], &milliseconds(seconds));
    }
    let lost = &method.lost_pixels;
    let rays_a_pixel = match method.rays_cast {
        0.0 => "\u{2013}".into(),
        rays => plain(rays / report.pixels_a_view()),
    };
    let mut figure = |name: &str, text: &str| {
        html.element("td", &[("data-figure", name)], text);
    };
    figure("rays_cast", &rays_a_pixel);
    figure("lost_pixels.mean", &percent(lost.mean));
    figure("lost_pixels.p95", &percent(lost.p95));
    figure("lost_pixels.worst", &percent(lost.worst));
    let ratio = method.times_the_floor.map_or_else(|| "\u{2013}".into(), |ratio| format!("{ratio:.2}"));
    figure("times_the_floor", &ratio);
    figure("views_with_loss", &method.views_with_loss.to_string());
    figure("wrongly_hidden.mean", &percent(method.wrongly_hidden.mean));
    for class in &method.classes {
        figure(&format!("wrongly_hidden_{}px.mean", class.at_least_px), &percent(class.wrongly_hidden.mean));
    }
    figure("needlessly_drawn.mean", &percent(method.needlessly_drawn.mean));
    figure("needless_triangles.mean", &percent(method.needless_triangles.mean));
    figure("culled.mean", &percent(method.culled.mean));
    html.close();
}

/// The figures that the methods' papers give, on this scene.
fn papers(html: &mut Html, report: &Report) {
    html.open("section", &[]).element("h2", &[], "As the papers count");
    html.open("div", &[("class", "scroll")])
        .open("table", &[("id", "papers")])
        .open("thead", &[])
        .open("tr", &[]);
    html.element("th", &[("class", "name")], "method");
    for column in
        ["culled, of all in view", "culled, of what is hidden", "small parts wrongly hidden", "95 %"]
    {
        html.element("th", &[], column);
    }
    html.close().close().open("tbody", &[]);
    for method in &report.methods {
        let class = if method.is_floor { "floor" } else { "method" };
        html.open("tr", &[("class", class)]).element("td", &[("class", "name")], &method.variant.to_string());
        for figure in [
            method.culled.mean,
            method.culled_of_hidden.mean,
            method.small_wrongly_hidden.mean,
            method.small_wrongly_hidden.p95,
        ] {
            html.element("td", &[], &percent(figure));
        }
        html.close();
    }
    html.close().close().close();
    let text = "Peng and Cao 2013, table 4: hzm culled 8.8 % of a Boeing 777 and exact occlusion culling 15.0 %, so that it culled \
                58.3 % of what is hidden. Xue et al. 2016, section 4.1: visible objects, typically of 200 vertices or less, \
                were taken for hidden 7 % of the time by voxels and 38 % of the time by boxes; here small parts are objects of \
                at most 200 vertices. Means over the views that have such parts; other scenes and other cameras.";
    html.element("p", &[("class", "soft")], text).close();
}

fn how_to_read(html: &mut Html, report: &Report) {
    let reference = format!(
        "The truth is a reference of {} exact rays per pixel that share no ray with the answers{}.",
        report.settings.run.reference_rays,
        match report.settings.run.reference_method {
            Method::Hybrid =>
                " (cast by hybrid, which answers as exact does; this was checked on the first view)",
            _ => "",
        }
    );
    let terms = [
        (
            "Lost pixels",
            "what a user would see missing: the share of the reference's samples on the model that fall on something the method does not draw.",
        ),
        (
            "Wrongly hidden",
            "the share of visible drawables that the method does not draw; again for those that cover at least 1, 4 and 16 pixels. A drawable is a placed part, or a piece of a big one.",
        ),
        (
            "Drawn for nothing",
            "the share of what the method draws that the reference does not see, in drawables and in triangles. It costs time, but nothing is wrong with the picture.",
        ),
        (
            "Culled",
            "the share of the drawables whose boxes meet the view pyramid that the method leaves out; of views with any.",
        ),
        (
            "Sampling floor",
            "what exact rays lose with as many rays in one frame: specks that lie between them. \u{d7} floor says how much more a \
             method loses; below 1, voxels thicker than what is in them caught specks that rays missed. Methods that keep \
             what earlier frames found had more rays, and have no such figure.",
        ),
    ];
    html.open("section", &[]).element("h2", &[], "How to read this").element("p", &[], &reference);
    for (term, text) in terms {
        html.open("p", &[]).element("b", &[], term).text(": ").text(text).close();
    }
    html.close();
}

fn charts(html: &mut Html, parts: &PageParts) {
    let charts = [
        (
            "time",
            "Time and error",
            &parts.pareto,
            "Each point is a number of rays per pixel, written beside it; each curve a method. 0 is its own line below the \
             decades. A method is good in both charts or not at all: to draw everything loses nothing.",
        ),
        ("spread", "How errors are spread", &parts.spread, "A method is as good as its bad views."),
        ("time", "Stages", &parts.stages, "What a faster machine, or a better stage, would change."),
    ];
    let frames = parts.frames.iter().map(|svg| {
        (
            "",
            "Frame by frame",
            svg,
            "A loss that lasts for some frames is seen; one that comes and goes flickers.",
        )
    });
    for (class, title, svg, caption) in charts.into_iter().chain(frames) {
        html.open("section", &[]).element("h2", &[], title).open("figure", &[("class", class)]);
        html.trusted(svg).element("figcaption", &[], caption).close().close();
    }
}

fn worst_views(html: &mut Html, report: &Report, worst: &[WorstPage]) {
    html.element("h2", &[], "The worst view of each method");
    for index in report.representatives() {
        let method = &report.methods[index];
        html.open("section", &[]).element("h3", &[], &method.variant.to_string());
        html.element("p", &[("class", "soft")], about(&method.variant.method));
        let view = method.worst_view;
        let (Some(frame), Some(view_report)) = (method.frames.get(view), report.views.get(view)) else {
            html.close();
            continue;
        };
        let Some(pictures) = worst.iter().find(|pictures| pictures.method == index) else {
            html.element("p", &[], "Lost nothing in any view.").close();
            continue;
        };
        html.open("p", &[]).text(&format!("{}: ", view_report.view.name));
        let lost = format!("{} of the visible pixels lost", percent(frame.accuracy.lost_pixels));
        html.element("span", &[("class", "bad")], &lost);
        html.text(&format!(
            ", {} of {} visible drawables wrongly hidden.",
            grouped(frame.accuracy.wrongly_hidden),
            grouped(frame.accuracy.reference)
        ));
        html.close().open("div", &[("class", "pair")]);
        picture(html, &pictures.reference, "What there is to see.");
        let caption = format!(
            "What is left of it: {} pixels with something lost, in red; the frame is enlarged below.",
            grouped(pictures.lost_pixels)
        );
        picture(html, &pictures.answer, &caption);
        html.close();
        picture(
            html,
            &pictures.detail,
            "Where most is lost: what there is, and what the method's answer shows.",
        );
        loss_table(html, &frame.lost, frame.lost_objects, false);
        if let Ok(camera) = serde_json::to_string(&view_report.view.camera) {
            html.element("p", &[("class", "soft")], "The camera, for voxsight render and visible:");
            html.element("pre", &[], &camera);
        }
        html.close();
    }
}

fn picture(html: &mut Html, png: &[u8], caption: &str) {
    let source = format!("data:image/png;base64,{}", STANDARD.encode(png));
    html.open("figure", &[]).open("img", &[("src", &source), ("alt", caption)]);
    html.element("figcaption", &[], caption).close();
}

fn lost_objects(html: &mut Html, report: &Report) {
    html.element("h2", &[], "Lost parts by name, over all views");
    let text = "Pixels are summed over the views in which something of the part was lost.";
    html.element("p", &[("class", "soft")], text);
    for index in report.representatives() {
        let method = &report.methods[index];
        html.open("section", &[]).element("h3", &[], &method.variant.to_string());
        if method.lost.is_empty() {
            html.element("p", &[], "None.");
        } else {
            loss_table(html, &method.lost, method.lost.len() as u64, true);
        }
        html.close();
    }
}

fn loss_table(html: &mut Html, lost: &[NamedLoss], count: u64, with_views: bool) {
    html.open("table", &[("class", "lost")]).open("thead", &[]).open("tr", &[]);
    html.element("th", &[("class", "name")], "part").element("th", &[], "pixels");
    if with_views {
        html.element("th", &[], "views");
    }
    html.close().close().open("tbody", &[]);
    for NamedLoss { path, lost } in lost.iter().take(LISTED_OBJECTS) {
        html.open("tr", &[]).element("td", &[("class", "name")], path);
        html.element("td", &[], &pixels(lost.pixels));
        if with_views {
            html.element("td", &[], &lost.views.to_string());
        }
        html.close();
    }
    html.close().close();
    let more = count.saturating_sub(LISTED_OBJECTS.min(lost.len()) as u64);
    if more > 0 {
        let text = format!("and {} more with fewer pixels each; see report.json", grouped(more));
        html.element("p", &[("class", "soft")], &text);
    }
}

fn how_it_was_done(html: &mut Html, report: &Report) {
    html.open("section", &[]).element("h2", &[], "How it was done");
    let settings = &report.settings;
    let order = if settings.is_path { "frames of one way, in order" } else { "views of their own" };
    let text = format!(
        "Version {}. {}: {} {order}, seed {}. Times are of {} threads, each the median of {} passes (of an even number the quicker one in the middle); every method goes \
         through all views in a row, and passes alternate between methods.",
        report.voxsight,
        settings.views,
        report.views.len(),
        settings.seed,
        rayon::current_num_threads(),
        settings.run.repeats,
    );
    html.element("p", &[("class", "time")], &text);
    if settings.run.frames_a_view > 1 {
        let text = format!(
            "Each view was shown for {} frames to methods that keep what they found: they are judged by the last, and their \
             times are those of all of them together.",
            settings.run.frames_a_view
        );
        html.element("p", &[], &text);
    }
    if let Some(rejected) = report.rejected {
        let text = format!(
            "To find places and directions inside the model, {} were drawn and turned down: {} places too close to \
             something, {} inside a single part, {} in the open; {} directions at a near wall, {} at next to nothing.",
            grouped(rejected.total()),
            grouped(rejected.too_close),
            grouped(rejected.in_a_part),
            grouped(rejected.in_the_open),
            grouped(rejected.at_a_wall),
            grouped(rejected.at_nothing),
        );
        html.element("p", &[], &text);
        if rejected.kept_in_the_open > 0 {
            let text = format!(
                "For {} views no place with enough around it was found; they are in the open, and named so.",
                grouped(rejected.kept_in_the_open)
            );
            html.element("p", &[], &text);
        }
    }
    let visible: Vec<f64> = report.views.iter().map(|view| view.facts.reference as f64).collect();
    let within: Vec<f64> = report.views.iter().map(|view| view.facts.in_frustum as f64).collect();
    let text = format!(
        "A view has {:.0} drawables in its pyramid and sees {:.0} of them (medians).",
        Distribution::of(&within).median,
        Distribution::of(&visible).median
    );
    html.element("p", &[], &text);
    html.element("p", &[], "report.json has every figure, every view's camera and every lost part; frames.csv a line for each view and method.");
    html.close();
}

fn view_name(report: &Report, view: usize) -> &str {
    report.views.get(view).map_or("", |view| &view.view.name)
}

/// A fraction as percent: three digits that count.
pub(crate) fn percent(fraction: f64) -> String {
    let value = 100.0 * fraction;
    let digits = match value {
        0.0 => return "0 %".into(),
        v if v < 0.000_1 => return "< 0.0001 %".into(),
        v if v < 0.1 => 4,
        v if v < 1.0 => 3,
        v if v < 10.0 => 2,
        _ => 1,
    };
    format!("{value:.digits$} %")
}

fn pixels(pixels: f64) -> String {
    if pixels < 10.0 { format!("{pixels:.2}") } else { grouped(pixels.round() as u64) }
}

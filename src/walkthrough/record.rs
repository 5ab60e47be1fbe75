//! What a frame did and took, and a table of it.

use std::fmt::Write;

use crate::gpu::frame::PASSES;

/// A frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameRecord {
    /// From 0.
    pub frame: u64,
    /// The camera has jumped.
    pub is_cut: bool,
    /// Frames since the camera of the visibility that was drawn.
    pub age: u64,
    /// Visible drawables.
    pub visible: u32,
    /// Drawn.
    pub drawn: u32,
    /// Of these, at another level than wanted.
    pub substituted: u32,
    /// Wanted, with nothing resident.
    pub missing: u32,
    /// All that fits into the budget and can be loaded is resident.
    pub is_complete: bool,
    /// Drawables that were not drawn in the frame before, are not drawn any more, are drawn at another level.
    pub delta: [u32; 3],
    /// Triangles drawn.
    pub triangles: u64,
    /// Bytes of pages written into the GPU's memory.
    pub written: u64,
    /// Bytes of pages given up.
    pub evicted: u64,
    /// Bytes moved to join free pieces.
    pub moved: u64,
    /// Copy commands.
    pub copies: u32,
    /// Bytes of pages in the GPU's memory.
    pub resident: u64,
    /// Pages that could not be loaded, so far.
    pub failed: u32,
    /// Milliseconds of the visibility query that was drawn, on its own thread.
    pub query_ms: f64,
    /// Levels of detail.
    pub select_ms: f64,
    /// What to load, write, draw.
    pub stream_ms: f64,
    /// Copies; until the GPU has done them, where the frame waits.
    pub upload_ms: f64,
    /// Drawing; likewise.
    pub draw_ms: f64,
    /// All of the frame, but for the query where it is not waited for.
    pub frame_ms: f64,
    /// Of [`PASSES`], by the GPU's own clock; where the frame waits, and the adapter has one.
    pub passes: Vec<(&'static str, f64)>,
}

/// The columns, in the order of [`csv_line`].
pub fn csv_header() -> String {
    let mut text = "frame,cut,age,visible,drawn,substituted,missing,added,removed,changed,triangles,bytes_in,bytes_out,bytes_moved,\
        copies,resident,failed_pages,query_ms,select_ms,stream_ms,upload_ms,draw_ms,frame_ms"
        .to_owned();
    for pass in PASSES {
        // Writing into a string cannot fail.
        let _ = write!(text, ",gpu_{pass}_ms");
    }
    text
}

/// A frame as a line of the table, without its end.
pub fn csv_line(record: &FrameRecord) -> String {
    let FrameRecord {
        frame,
        age,
        visible,
        drawn,
        substituted,
        missing,
        delta: [added, removed, changed],
        ..
    } = record;
    let FrameRecord { triangles, written, evicted, moved, copies, resident, failed, .. } = record;
    let FrameRecord { query_ms, select_ms, stream_ms, upload_ms, draw_ms, frame_ms, .. } = record;
    let mut text = format!(
        "{frame},{},{age},{visible},{drawn},{substituted},{missing},{added},{removed},{changed},{triangles},{written},{evicted},{moved},\
         {copies},{resident},{failed},{query_ms:.3},{select_ms:.3},{stream_ms:.3},{upload_ms:.3},{draw_ms:.3},{frame_ms:.3}",
        u8::from(record.is_cut)
    );
    for pass in PASSES {
        let time = record.passes.iter().find(|(name, _)| *name == pass);
        let _ = match time {
            Some((_, time)) => write!(text, ",{time:.3}"),
            None => write!(text, ","),
        };
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_have_a_value_for_each_column() {
        let record = FrameRecord {
            frame: 7,
            is_cut: true,
            delta: [1, 2, 3],
            passes: vec![("shade", 0.5), ("geometry", 2.25)],
            ..FrameRecord::default()
        };
        let (header, line) = (csv_header(), csv_line(&record));
        let columns: Vec<(&str, &str)> = header.split(',').zip(line.split(',')).collect();
        assert_eq!(header.split(',').count(), line.split(',').count());
        for expected in [
            ("frame", "7"),
            ("cut", "1"),
            ("changed", "3"),
            ("gpu_geometry_ms", "2.250"),
            ("gpu_shadow_ms", ""),
        ] {
            assert!(columns.contains(&expected), "{expected:?} in {columns:?}");
        }
    }
}

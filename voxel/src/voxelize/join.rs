//! Joins the sub-DAGs of the tasks, in depth-first order, into one.

use super::cell::Cell;
use super::task::SubDag;
use super::{OwnerSink, VoxelizeError};
use crate::dag::build::{DagTables, NodeDraft};
use crate::dag::node::slot;
use crate::dag::{Dag, DagError};

/// The DAG so far. Owner pages go to the sink as they come.
pub(super) struct Joiner<'a> {
    tables: DagTables,
    upper: UpperNodes,
    sink: &'a mut (dyn OwnerSink + Send),
    /// First ordinal and first word of each owner page.
    directory: Vec<[u64; 2]>,
    bricks: u64,
    owner_words: u64,
}

impl<'a> Joiner<'a> {
    /// For a root of this height.
    pub fn new(height: u32, sink: &'a mut (dyn OwnerSink + Send)) -> Self {
        Joiner {
            tables: DagTables::new(height),
            upper: UpperNodes::new(height),
            sink,
            directory: Vec::new(),
            bricks: 0,
            owner_words: 0,
        }
    }

    /// The next one.
    pub fn add(&mut self, part: &SubDag) -> Result<(), VoxelizeError> {
        let Some(root) = part.root else { return Ok(()) };
        // Nodes go to the tables where they end, depth first: those that end before this part, before its own.
        self.upper.close_all_but_above(&mut self.tables, part.cell)?;
        let node = self.tables.merge(&part.tables, root)?;
        self.upper.add(part.cell, node);
        let pages = part.owners.directory.iter();
        self.directory.extend(pages.map(|[first, word]| [first + self.bricks, word + self.owner_words]));
        self.sink.append(&part.owners.pages).map_err(VoxelizeError::Owners)?;
        self.bricks += part.owners.bricks;
        self.owner_words += part.owners.pages.len() as u64;
        Ok(())
    }

    /// Bytes in use, about.
    pub fn bytes(&self) -> u64 {
        self.tables.bytes() + 16 * self.directory.capacity() as u64
    }

    /// Words that went to the sink.
    pub fn owner_words(&self) -> u64 {
        self.owner_words
    }

    /// The DAG, and the directory of the owner pages.
    pub fn finish(mut self, log2: u32) -> Result<(Dag, Vec<[u64; 2]>), DagError> {
        let root = self.upper.finish(&mut self.tables)?;
        Ok((self.tables.finish(log2, root)?, self.directory))
    }
}

/// Nodes above the tasks, made as the tasks come in depth-first order.
struct UpperNodes {
    /// Draft of the open node of each height, index 0 for height 1, and its corner.
    open: Vec<(NodeDraft, [i32; 3])>,
    root: Option<u32>,
}

impl UpperNodes {
    fn new(height: u32) -> Self {
        UpperNodes { open: (0..height).map(|_| (NodeDraft::default(), [0; 3])).collect(), root: None }
    }

    /// Closes what is complete when this cell comes: all nodes that are not above it.
    fn close_all_but_above(&mut self, tables: &mut DagTables, cell: Cell) -> Result<(), DagError> {
        for height in 1..=self.open.len() as u32 {
            let (draft, corner) = &self.open[height as usize - 1];
            let shift = 2 * height + 2;
            let is_above =
                height > cell.height && (0..3).all(|k| corner[k] == cell.corner[k] >> shift << shift);
            if !draft.is_empty() && !is_above {
                self.close(tables, height)?;
            }
        }
        Ok(())
    }

    /// Adds a node to the open one above it.
    fn add(&mut self, cell: Cell, node: u32) {
        let Some((draft, corner)) = self.open.get_mut(cell.height as usize) else {
            self.root = Some(node);
            return;
        };
        let shift = 2 * cell.height + 4;
        *corner = cell.corner.map(|c| c >> shift << shift);
        draft.add(slot(cell.corner, 2 * cell.height + 2), node);
    }

    fn close(&mut self, tables: &mut DagTables, height: u32) -> Result<(), DagError> {
        let (draft, corner) = &mut self.open[height as usize - 1];
        let node = tables.heights[height as usize - 1].intern(draft)?;
        draft.begin(0);
        let cell = Cell { corner: *corner, height };
        self.add(cell, node);
        Ok(())
    }

    fn finish(mut self, tables: &mut DagTables) -> Result<Option<u32>, DagError> {
        for height in 1..=self.open.len() as u32 {
            if !self.open[height as usize - 1].0.is_empty() {
                self.close(tables, height)?;
            }
        }
        Ok(self.root)
    }
}

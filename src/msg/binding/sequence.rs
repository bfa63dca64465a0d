//! Message counter of a sender, which wraps at the width of its field.

use super::{BindingError, plan};
use crate::msg::definition::{Primitive, TypeTree};
use crate::msg::dynamic::{ElementKind, FieldPlan, ReadAs, ReadError};

/// A counter of any width, extended to 32 bits.
#[derive(Debug, Clone)]
pub(super) struct SequencePlan {
    plan: FieldPlan,
    n_bits: u32,
    last: Option<(u64, u32)>, // as sent, and as extended
}

impl SequencePlan {
    pub(super) fn compile(tree: &TypeTree, path: &str) -> Result<Self, BindingError> {
        let refused = |found: String| BindingError::NoCounter {
            path: path.to_owned(),
            type_name: tree.type_name().to_owned(),
            found,
        };
        let plan = plan("sequence", tree, path, ReadAs::Nanos)?;
        match plan.kind().element {
            ElementKind::Number(Primitive::Bool | Primitive::Float32 | Primitive::Float64) => {
                Err(refused(plan.kind().to_string()))
            }
            ElementKind::Number(primitive) => {
                let n_bits = 8 * primitive.size() as u32;
                Ok(SequencePlan { plan, n_bits, last: None })
            }
            _ => Err(refused(plan.kind().to_string())),
        }
    }

    /// Count of a message. A narrower counter continues after it wraps, and one that goes back goes back.
    pub(super) fn read(&mut self, cdr: &[u8]) -> Result<u32, ReadError> {
        let sent = self.plan.read_nanos(cdr, 1)? as u64; // negative counts in two's complement
        let spare = 64 - self.n_bits;
        let told = match self.last {
            // A step of half of the counter's range or more counts as a step back.
            Some((last, told)) if self.n_bits < 32 => {
                told.wrapping_add((sent.wrapping_sub(last) << spare).cast_signed().wrapping_shr(spare) as u32)
            }
            _ => sent as u32,
        };
        self.last = Some((sent, told));
        Ok(told)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Extended counts of a field with this type that has these values.
    fn told(name: &str, counts: &[i64]) -> Vec<u32> {
        let tree = TypeTree::from_schema("pkg/msg/T", &format!("{name} count\n")).unwrap();
        let mut plan = SequencePlan::compile(&tree, "count").unwrap();
        let cdr = |count: &i64| [&[0, 1, 0, 0], &count.to_le_bytes()[..]].concat(); // narrower ones are its first bytes
        counts.iter().map(|count| plan.read(&cdr(count)).unwrap()).collect()
    }

    #[test]
    fn counters_of_any_width_go_on_where_they_wrap() {
        assert_eq!(told("uint8", &[254, 255, 256, 257, 260]), [254, 255, 256, 257, 260]);
        assert_eq!(told("uint16", &[65_534, 65_535, 65_536, 65_540]), [65_534, 65_535, 65_536, 65_540]);
        assert_eq!(told("int8", &[126, 127, -128, -127, -1, 0]), [126, 127, 128, 129, 255, 256]);
        assert_eq!(told("int16", &[32_767, -32_768]), [32_767, 32_768]);
        assert_eq!(told("uint32", &[u32::MAX.into(), 0, 1]), [u32::MAX, 0, 1]);
        assert_eq!(told("int32", &[i32::MAX.into(), i32::MIN.into()]), [(1 << 31) - 1, 1 << 31]);
        assert_eq!(told("int64", &[(1 << 32) - 1, 1 << 32, (1 << 32) + 1]), [u32::MAX, 0, 1]);
        assert_eq!(told("uint64", &[-1, 0]), [u32::MAX, 0]);
    }

    #[test]
    fn a_sender_that_starts_over_goes_back_and_loses_no_messages() {
        let [.., last, begun] = told("uint16", &[5_000, 5_001, 0])[..] else { panic!() };
        assert!(begun.wrapping_sub(last) > u32::MAX / 2, "{last} {begun}");
        let [.., last, begun] = told("uint8", &[99, 100, 0])[..] else { panic!() };
        assert!(begun.wrapping_sub(last) > u32::MAX / 2, "a counter to 100: {last} {begun}");
    }
}

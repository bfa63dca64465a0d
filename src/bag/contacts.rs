//! Contacts out of a bag, as whoever wrote it had their type: messages have gained fields over time.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use super::BagMessage;
use super::error::one_line;
use crate::msg::definition::TypeTree;
use crate::msg::dynamic::{Value, read_value};
use crate::msg::{ContactArray, ContactState, Header, Time, WireType, from_cdr, rihs01, type_hash};

/// Reads the [`ContactArray`]s of a bag by the schemas of their channels.
#[derive(Debug, Default)]
pub struct ContactReader {
    /// By channel id; none where the type is as it is now.
    layouts: BTreeMap<usize, Option<TypeTree>>,
}

impl ContactReader {
    /// The contacts that a message holds. What its type didn't have yet is NaN.
    ///
    /// # Errors
    /// One line that says what is wrong with the message or its definition.
    pub fn read(&mut self, message: &BagMessage<'_>) -> Result<ContactArray, String> {
        let layout = match self.layouts.entry(message.channel.id) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(unknown) => unknown.insert(older_layout(message)?),
        };
        match layout {
            Some(tree) => read_older(tree, message.data),
            None => from_cdr(message.data).map_err(|error| error.to_string()),
        }
    }
}

/// The definition that a channel's messages follow, where it is another one than ours is now.
fn older_layout(message: &BagMessage<'_>) -> Result<Option<TypeTree>, String> {
    let Some(schema) = message.channel.schema.as_ref().filter(|schema| !schema.data.is_empty()) else {
        return Ok(None);
    };
    let text = String::from_utf8_lossy(&schema.data);
    let tree = TypeTree::from_encoded(ContactArray::TYPE_NAME, &schema.encoding, &text)
        .map_err(|error| one_line(&error.to_string()))?;
    let is_ours = rihs01(ContactArray::TYPE_NAME).is_some_and(|ours| ours == type_hash(&tree));
    Ok((!is_ours).then_some(tree))
}

fn read_older(tree: &TypeTree, cdr: &[u8]) -> Result<ContactArray, String> {
    let (array, _) = read_value(tree, cdr).map_err(|error| error.to_string())?;
    contact_array(&array).ok_or_else(|| {
        format!("its {} lacks fields that every version has had: expected header and contacts", ContactArray::TYPE_NAME)
    })
}

fn contact_array(array: &Value<'_>) -> Option<ContactArray> {
    let header = array.field("header")?;
    Some(ContactArray {
        header: Header { stamp: time(header.field("stamp")?)?, frame_id: text(header.field("frame_id")?)? },
        contacts: array.field("contacts")?.elements()?.iter().map(contact_state).collect::<Option<_>>()?,
    })
}

fn contact_state(state: &Value<'_>) -> Option<ContactState> {
    let number = |name: &str| float(state.field(name)?);
    Some(ContactState {
        region: text(state.field("region")?)?,
        frame_id: text(state.field("frame_id")?)?,
        contact_raw: truth(state.field("contact_raw")?)?,
        contact: truth(state.field("contact")?)?,
        event: u8::try_from(unsigned(state.field("event")?)?).ok()?,
        since: time(state.field("since")?)?,
        force: number("force")?,
        force_base: number("force_base")?,
        artifact: number("artifact")?,
        on_threshold: number("on_threshold")?,
        off_threshold: number("off_threshold")?,
        mdf: number("mdf")?,
        pose_age: number("pose_age")?,
        age: number("age").unwrap_or(f64::NAN), // came after the others
        flags: u32::try_from(unsigned(state.field("flags")?)?).ok()?,
        // These came after the others, too.
        adaptation: state
            .field("adaptation")
            .and_then(unsigned)
            .and_then(|value| u8::try_from(value).ok())
            .unwrap_or(0),
        artifact_change: number("artifact_change").unwrap_or(f64::NAN),
        touch: number("touch").unwrap_or(f64::NAN),
        touch_on: number("touch_on").unwrap_or(f64::NAN),
        touch_off: number("touch_off").unwrap_or(f64::NAN),
    })
}

fn time(value: &Value<'_>) -> Option<Time> {
    let Value::Int(sec) = value.field("sec")? else { return None };
    let nanosec = unsigned(value.field("nanosec")?)?;
    Some(Time { sec: i32::try_from(*sec).ok()?, nanosec: u32::try_from(nanosec).ok()? })
}

fn text(value: &Value<'_>) -> Option<String> {
    if let Value::Text(text) = value { Some(text.clone()) } else { None }
}

fn truth(value: &Value<'_>) -> Option<bool> {
    if let Value::Bool(truth) = value { Some(*truth) } else { None }
}

fn unsigned(value: &Value<'_>) -> Option<u64> {
    if let Value::Unsigned(number) = value { Some(*number) } else { None }
}

fn float(value: &Value<'_>) -> Option<f64> {
    if let Value::Float(number) = value { Some(*number) } else { None }
}

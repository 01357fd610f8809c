/** Which texts of the sources are prose that a person reads. A wrong "yes" could break a control in another language, so that every rule is narrow. */

/** Attributes and component properties whose text a person reads. */
const SHOWN_ATTRIBUTES =
  /^(aria-label|aria-description|aria-valuetext|aria-roledescription|legend|closeHint|closeLabel|contentLabel|title|placeholder|alt|label|text|hint|note|caption|summary|empty|why|unavailable|reason|action|confirm|verb|description|explanation|\w+Text)$/;
/** Properties and variables of the scripts of which one word alone is also shown: `{ label: 'Hold' }`. */
const SHOWN_NAMES =
  /^(label|title|text|hint|note|caption|summary|description|explanation|words?|verb|tooltip|short|long|placeholder)$|(Label|Title|Text|Hint|Words|Verb|Note)$|^(LABELS?|TITLES?|TEXTS?|HINTS?|WORDS?|NAMES?)$|_(LABELS?|TITLES?|TEXTS?|HINTS?|WORDS?|NAMES?)$/;
/** Elements without prose. */
export const SILENT_ELEMENTS = new Set(['script', 'style', 'path', 'svg', 'code', 'pre', 'kbd']);
/** Functions whose arguments are names for the machine, not texts. */
const MACHINE_CALLS =
  /^(fetch|matchMedia|addEventListener|removeEventListener|querySelector|querySelectorAll|closest|matches|getElementById|getAttribute|setAttribute|toggleAttribute|removeAttribute|hasAttribute|createElement|createElementNS|getItem|setItem|removeItem|includes|startsWith|endsWith|indexOf|lastIndexOf|has|get|delete|split|RegExp|Set|URL|GET|POST|PUT|DELETE|PATCH|setPaintProperty|setLayoutProperty|getContext|dispatchEvent|CustomEvent|Event|setProperty|getPropertyValue|toggle|contains|postMessage|glob|slice|assign|boundsOf)$/;

/** Units and names that are the same in every language. */
const SAME =
  /\b(m|km|cm|mm|ft|s|ms|min|h|Hz|kHz|kB|MB|GB|px|deg|rad|V|A|W|Wh|ha|mAh|rpm|hPa|dB|NED|FRD|ENU|WGS84|AMSL|MAVLink|PX4|ROS|QGroundControl|GPS|RTK|UTM|UDP|TCP|JSON|CSV|KML)\b/g;

/** The text without holes, units and names; what a hole chooses is text. */
const words = (text) =>
  text
    .replace(/\{\d+\?([^{}:]*):([^{}]*)\}/g, ' $1 $2 ')
    .replace(/\{\d+\}/g, ' # ')
    .replace(/<\/?\d+\/?>/g, ' ')
    .replace(SAME, ' ');

/** A sentence or part of one: at least one word of two small letters, and a space. */
export function isProse(text) {
  if (/^(Shift|Ctrl|Alt) /.test(text) || /px\b|sans-serif|^[a-z]+ (stops|point|drag)$/.test(text)) return false; // keys, fonts, classes
  if (/^[\w-]*\(.*\)$/.test(text.trim()) || /^[a-z-]+:[^ ]/.test(text) || /^(https?:|\/|\.\/|#[^ ]|@|--|M ?-?[\d{])/.test(text)) return false;
  if (/^[a-z0-9]+(-[a-z0-9]+)+( [a-z0-9-]+)*$/.test(text)) return false; // names of CSS classes
  return /\s/.test(text.trim() === text ? text : `${text} `) && /\p{L}\p{Ll}/u.test(words(text));
}

/** One word that a person could read: "Hold", "Armed", "unknown". */
export const isWord = (text) =>
  /\p{L}\p{Ll}/u.test(words(text)) && !/[_/\\<>{}=;]|--/.test(text.replace(/\{\d+(\?[^{}]*)?\}/g, '')) && !/\p{Ll}\p{Lu}|px$|^\./u.test(text);

/** A name with a capital letter, which is shown unless it is compared somewhere: "Hold", "Battery". */
export const isName = (text) => /^\p{Lu}\p{Ll}/u.test(text) && isWord(text);

/** Properties of the scripts whose values are for the machine: `{ type: 'Polygon' }`, and all that is sent in a request. */
export const isMachineProperty = (name) =>
  /^(body|confirm|type|id|key|kind|icon|keys|mode|method|element|event|code|tone|filter|paint|layout|severity|state|unit|frame_id)$/.test(name ?? '');

export const isShownAttribute = (name) => SHOWN_ATTRIBUTES.test(name);
export const isShownName = (name) => name !== null && SHOWN_NAMES.test(name);
export const isMachineCall = (name) => name !== null && MACHINE_CALLS.test(name);

/** Functions of which the first argument alone is a name for the machine. */
export const hasMachineName = (name) => name === 'set' || name === 'append';

/** Arguments that are shown, of functions that also get names for the machine: the places of the shown ones. */
const SHOWN_ARGUMENTS = new Map(Object.entries({ numberSpec: [0], emptyIndicator: [0], quantity: [1], conditionRow: [1], positionFields: [3] }));
export const isShownArgument = (name, place) => SHOWN_ARGUMENTS.get(name)?.includes(place) ?? false;

/** A shown text must not decide anything: it is another one in another language. */
export const isShownProperty = (name) => /^(label|title|text|hint|note|caption|description)$/.test(name ?? '');
